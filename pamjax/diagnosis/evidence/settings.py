"""Settings of the choice by evidence: what is assumed before a recording is looked at."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class EvidenceSettings:
    """Assumptions of a choice by evidence.

    Attributes:
        form_shares: possible sizes of a form error, as a share of the textbook effect (rms) ...
        form_share_probabilities: ... and their prior probabilities.
        mechanism_probability: prior probability of each mechanism.
        generic_probability: prior probability of physics that no mechanism describes.
        template_probability: prior probability of an effect that resembles one of the templates.
        generic_sizes: possible sizes of this physics, in standard deviations of the noise of a sample; sizes
            above the misfit of the baseline are not used.
        max_form_share: an effect whose form error is larger than this share is not its mechanism.
        min_outside_share: physics outside the library is reported if it explains at least this share of the
            baseline's excess misfit.
        established_probability: probability from which a mechanism is named.
        tie_probability_ratio: alternatives with at least this share of the probability are
            indistinguishable.
        max_mechanisms: largest number of mechanisms in a model.
        max_prior_deviation_sd: largest distance of a baseline parameter from its stated value, in its sd; a
            close limit makes the evidence of a mechanism depend on which parameter reaches it.
    """

    form_shares: tuple[float, ...] = (0.0, 0.03, 0.1, 0.3)
    form_share_probabilities: tuple[float, ...] = (0.25, 0.25, 0.25, 0.25)
    mechanism_probability: float = 0.05
    generic_probability: float = 0.1
    template_probability: float = 0.1
    generic_sizes: tuple[float, ...] = (0.3, 1.0, 3.0, 10.0)
    max_form_share: float = 0.5
    min_outside_share: float = 0.01
    established_probability: float = 0.5
    tie_probability_ratio: float = 0.1
    max_mechanisms: int = 4
    max_prior_deviation_sd: float = 8.0
