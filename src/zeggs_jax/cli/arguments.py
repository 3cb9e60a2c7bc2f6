"""Kinds of argument that several commands share."""

from pathlib import Path
from typing import Annotated

from tyro.conf import UseAppendAction, arg

Out = Annotated[Path, arg(aliases=["-o"])]
Styles = Annotated[UseAppendAction[tuple[str, ...]], arg(aliases=["-s"], metavar="STYLE")]
Ranges = Annotated[tuple[str, ...], arg(metavar="A:B")]
