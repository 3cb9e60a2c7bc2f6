"""What each group of a report wears, in tables, drawings and players alike."""

from collections.abc import Mapping, Sequence
from html import escape
from typing import Any

from zeggs_jax.stage.player import COLOURS

TRUTH = "truth"
SLATE = "#64788e"  # what the recorded body wears


def colours(groups: Sequence[str]) -> dict[str, str]:
    """What each group wears, everywhere on the page."""
    made = [group for group in groups if group != TRUTH]
    return {TRUTH: SLATE} | {group: COLOURS[k % (len(COLOURS) - 1)] for k, group in enumerate(made)}


def swatch(group: str, found: Mapping[str, Any]) -> str:
    """A dot in the group's colour, and its name."""
    return f'<i class="swatch" style="background:{colours(list(found["groups"]))[group]}"></i>{escape(group)}'
