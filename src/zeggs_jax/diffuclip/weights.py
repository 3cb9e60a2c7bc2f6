"""Published weights that settings ask for: are their folders there, and do they fit, before hours are spent."""

from typing import Any

from . import joint_embedding, safetensors_folder
from .config import DiffuclipConfig


def check(config: DiffuclipConfig) -> None:
    """Reads the small files of T5's and CLIP's folders, where `config` asks for these models.

    Raises:
        ValueError, OSError: no folder is named, it is not there, is of another architecture or of other sizes.
    """
    if config.joint.text == "t5":
        found = _described("T5", config.joint.folder, "--t5", ("t5", "mt5", "umt5"))
        _check_size("T5", config.joint.folder, found.get("d_model"), "joint.width", config.joint.width)
        joint_embedding.reader(config.joint)
    if "clip" in (config.prompts.text, config.prompts.image):
        found = _described("CLIP", config.prompts.clip, "--clip", ("clip",))
        _check_size("CLIP", config.prompts.clip, found.get("projection_dim"), "prompts.size", config.prompts.size)
        if config.prompts.text == "clip":
            safetensors_folder.tokenizer(config.prompts.clip)


def _described(name: str, folder: str, flag: str, kinds: tuple[str, ...]) -> dict[str, Any]:
    """The folder's config.json, once its weights are seen too."""
    if not folder:
        raise ValueError(
            f"the settings read {name} but name no folder with it; give {flag} FOLDER, or --small, which needs none."
        )
    found = safetensors_folder.config(folder, *kinds)
    safetensors_folder.places(folder)
    return found


def _check_size(name: str, folder: str, has: Any, setting: str, wanted: int) -> None:
    if has != wanted:
        raise ValueError(
            f"the {name} in '{folder}' makes vectors of {has} numbers, the settings expect {setting} = {wanted}; "
            f"set {setting} to {has} in a --config, or give another {name}."
        )
