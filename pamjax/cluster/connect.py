"""A Dask client: on an embedded cluster of this machine, or on a cluster that exists."""

from __future__ import annotations

import logging
import os
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any

from pamjax.compile.platform import choose_platform
from pamjax.errors import BadInput, check_minimum
from pamjax.units import format_count

if TYPE_CHECKING:
    from distributed import Client

#: Command that installs the optional packages of a fleet.
_INSTALL_COMMAND = "pip install -e '.[fleet]'"

#: Time to wait for a scheduler, s.
CONNECT_TIMEOUT = 10

#: Settings of an embedded cluster. A worker that pauses at high memory would never run again, because the
#: memory of JAX stays; such a worker is ended at 95 % of its limit and replaced.
_EMBEDDED_SETTINGS = {
    "distributed.scheduler.allowed-failures": 0,
    "distributed.worker.memory.target": False,
    "distributed.worker.memory.spill": False,
    "distributed.worker.memory.pause": False,
    "distributed.worker.memory.terminate": 0.95,
}


def check_packages() -> None:
    """Check that the optional packages of a fleet are present.

    Raises:
        BadInput: with the command that installs them.
    """
    from importlib.util import find_spec

    missing = [name for name in ("dask", "distributed", "pyarrow") if find_spec(name) is None]
    if missing:
        names = missing[0] if len(missing) == 1 else f"{', '.join(missing[:-1])} and {missing[-1]}"
        rule = f"`pamjax fleet` needs {format_count(len(missing), 'more package')}: {names}"
        raise BadInput.from_rule(
            rule, remedy=f"Run `{_INSTALL_COMMAND}` in the folder of the pamjax repository."
        )


def parse_memory(text: str) -> int:
    """Return a memory size in bytes.

    Raises:
        BadInput: if it is no positive size.
    """
    from dask.utils import parse_bytes

    try:
        size = parse_bytes(text)
    except ValueError:
        size = 0
    if size <= 0 or not any(sign.isalpha() for sign in text):
        raise BadInput.from_rule(
            "`--memory` must be a size with a unit", repr(text), remedy='Write it as "4 GB".'
        )
    return size


@contextmanager
def start_cluster(workers: int | None = None, memory: str | None = None) -> Iterator[Client]:
    """Yield the client of a cluster of processes on this machine, one thread each.

    Args:
        workers: number of processes; None for the number of cores.
        memory: memory limit of each process, as "4 GB"; None for an equal share of the machine.
    """
    import dask
    from distributed import Client, LocalCluster

    if workers is not None:
        check_minimum("workers", workers, 1)
    limit = "auto" if memory is None else parse_memory(memory)
    environment = {"TF_CPP_MIN_LOG_LEVEL": "3", **choose_platform(os.environ)}
    no_dashboard: Any = None
    with (
        dask.config.set(_EMBEDDED_SETTINGS),
        LocalCluster(
            n_workers=workers or os.cpu_count() or 1,
            threads_per_worker=1,
            processes=True,
            memory_limit=limit,
            dashboard_address=no_dashboard,
            silence_logs=logging.CRITICAL,
            env=environment,
        ) as cluster,
        Client(cluster) as client,
    ):
        yield client


@contextmanager
def connect_to_scheduler(address: str, store: Path) -> Iterator[Client]:
    """Yield a client of a cluster that exists.

    Args:
        address: address of the scheduler, as "tcp://host:8786".
        store: folder that every worker must see under this path.

    Raises:
        BadInput: if no scheduler answers, or a worker has another pamjax or does not see the store.
    """
    from distributed import Client

    try:
        client = Client(address, timeout=CONNECT_TIMEOUT)
    except (OSError, ValueError, TypeError) as error:
        rule, remedy = "`--scheduler` must be the address of a Dask scheduler", "Check that it runs."
        raise BadInput.from_rule(rule, f"{address!r}, where none answers", remedy=remedy) from error
    with client:
        _check_workers(client, store)
        yield client


def _check_workers(client: Client, store: Path) -> None:
    """Refuse workers with other sources of pamjax, or without the folder of the store."""
    from pamjax.fleet.task import collect_task_versions

    try:
        answers: Any = client.run(_inspect_worker, str(store))
    except ImportError as error:
        remedy = f"Install it there: {_INSTALL_COMMAND}."
        raise BadInput.from_rule(
            "every worker must have pamjax", f"a worker without ({error})", remedy=remedy
        ) from error
    own = collect_task_versions()
    for worker, (versions, sees_store) in answers.items():
        different = [name for name, value in own.items() if versions.get(name) != value]
        if different:
            name = different[0]
            rule = f"every worker must have the {name} of this process ({own[name][:12]})"
            got = f"{str(versions.get(name))[:12]} on {worker}"
            raise BadInput.from_rule(rule, got, remedy="Use one environment for all.")
        if not sees_store:
            rule = f"every worker must see the folder {store}"
            raise BadInput.from_rule(
                rule, f"{worker}, which does not", remedy="Use a folder that all machines share."
            )


def _inspect_worker(store: str) -> tuple[dict[str, str], bool]:
    """Return the versions of a worker, and whether it sees a folder."""
    from pamjax.fleet.task import collect_task_versions

    return collect_task_versions(), Path(store).is_dir()
