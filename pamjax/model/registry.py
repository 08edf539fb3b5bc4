"""The library of mechanisms by id, and the pairs that exclude each other."""

from __future__ import annotations

from collections.abc import Iterable

from pamjax.errors import BadInput, suggest_word
from pamjax.model.mechanism import AbstractMechanism
from pamjax.model.mechanisms.bladder_elasticity import BladderElasticity
from pamjax.model.mechanisms.braid_elasticity import BraidElasticity
from pamjax.model.mechanisms.braid_friction import BraidFriction
from pamjax.model.mechanisms.braid_locking import BraidLocking
from pamjax.model.mechanisms.channel_lag import ChannelLag
from pamjax.model.mechanisms.contact_pressure import ContactPressure
from pamjax.model.mechanisms.contraction_factor import ContractionFactor
from pamjax.model.mechanisms.diameter_offset import DiameterOffset
from pamjax.model.mechanisms.end_cones import EndCones
from pamjax.model.mechanisms.end_taper import EndTaper
from pamjax.model.mechanisms.force_drift import ForceDrift
from pamjax.model.mechanisms.force_gain import ForceGain
from pamjax.model.mechanisms.force_offset import ForceOffset
from pamjax.model.mechanisms.length_offset import LengthOffset
from pamjax.model.mechanisms.mullins_softening import MullinsSoftening
from pamjax.model.mechanisms.pressure_drop import PressureDrop
from pamjax.model.mechanisms.pressure_gain import PressureGain
from pamjax.model.mechanisms.pressure_offset import PressureOffset
from pamjax.model.mechanisms.rig_compliance import RigCompliance
from pamjax.model.mechanisms.thread_crimp import ThreadCrimp
from pamjax.model.mechanisms.thread_slip import ThreadSlip
from pamjax.model.mechanisms.viscoelastic_creep import ViscoelasticCreep
from pamjax.model.mechanisms.viscous_damping import ViscousDamping

#: The mechanisms, in the order in which those of one kind act. A sensor applies its gain before its offset:
#: the true value is computed with the offset first, the recorded value with the gain first.
MECHANISMS: tuple[type[AbstractMechanism], ...] = (
    BraidElasticity,
    ThreadCrimp,
    BladderElasticity,
    BraidLocking,
    EndTaper,
    BraidFriction,
    ViscousDamping,
    ViscoelasticCreep,
    MullinsSoftening,
    ThreadSlip,
    PressureDrop,
    ContactPressure,
    RigCompliance,
    PressureOffset,
    PressureGain,
    LengthOffset,
    ForceGain,
    ForceOffset,
    ForceDrift,
    DiameterOffset,
    ChannelLag,
)

#: Other textbook equations of the effect of one mechanism, for fits and comparisons. They are not combined
#: with it. A diagnosis does not select them, and the bench with all mechanisms does not contain them.
ALTERNATIVE_EQUATIONS: tuple[type[AbstractMechanism], ...] = (EndCones, ContractionFactor)

_SAME_END_EFFECT = "both describe the same force loss at the ends"

#: Pairs of mechanisms with the same effect, and the reason.
EXCLUSIVE_PAIRS: dict[frozenset[str], str] = {
    frozenset({"force_gain", "pressure_gain"}): "force is proportional to both gains, so that only a weight"
    " on the load cell or a second gauge distinguishes them",
    frozenset({"pressure_offset", "contact_pressure"}): "above the threshold both subtract one pressure",
    frozenset({"bladder_elasticity", "contact_pressure"}): "a constant dead band is the hoop part of the"
    " bladder's elasticity",
    frozenset({"end_taper", "end_cones"}): _SAME_END_EFFECT,
    frozenset({"end_taper", "contraction_factor"}): _SAME_END_EFFECT,
    frozenset({"end_cones", "contraction_factor"}): _SAME_END_EFFECT,
}


def list_mechanisms() -> dict[str, type[AbstractMechanism]]:
    """Return the mechanisms and their alternative equations by id."""
    return {kind.id: kind for kind in MECHANISMS + ALTERNATIVE_EQUATIONS}


def find_mechanism(id: str) -> type[AbstractMechanism]:
    """Return the mechanism of an id.

    Raises:
        BadInput: if the id is unknown; the message suggests the most similar id.
    """
    mechanisms = list_mechanisms()
    if id not in mechanisms:
        raise BadInput.from_rule(f"unknown mechanism `{id}`", remedy=suggest_word(id, mechanisms))
    return mechanisms[id]


def order_mechanisms(ids: Iterable[str]) -> tuple[type[AbstractMechanism], ...]:
    """Return these mechanisms in the order in which they act.

    Raises:
        BadInput: if an id is unknown.
    """
    selected_kinds = {find_mechanism(id) for id in ids}
    return tuple(kind for kind in MECHANISMS + ALTERNATIVE_EQUATIONS if kind in selected_kinds)


def check_exclusive_pairs(ids: Iterable[str]) -> None:
    """Refuse pairs of mechanisms with the same effect.

    Raises:
        BadInput: if both mechanisms of such a pair are present.
    """
    selected_ids = set(ids)
    for pair, reason in EXCLUSIVE_PAIRS.items():
        if pair <= selected_ids:
            first, second = sorted(pair)
            rule = f"`{first}` and `{second}` exclude each other: {reason}"
            raise BadInput.from_rule(rule, remedy="Use only one of them.")
