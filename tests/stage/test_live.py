"""The live page's text: whole in itself, and it tells the body that the server streams."""

import json
import re

import numpy as np
import pytest

from zeggs_jax.motion import features
from zeggs_jax.stage import live


@pytest.fixture
def page(clip):
    first = clip._replace(euler=clip.euler[:1], positions=clip.positions[:1])
    return first, live.page(first, ("old", "</script>"), "old")


def test_the_page_asks_nobody_but_its_server(page):
    text = page[1].replace("http-equiv", "")
    assert not re.search(r"https?://|src=|href=\"(?!data:)", text)
    assert "connect-src 'self' ws:" in text
    assert "{{" not in text


def test_the_page_knows_the_body(page):
    first, text = page
    scene = json.loads(re.search(r'id="scene">(.*?)</script>', text, re.DOTALL)[1])
    assert scene["styles"] == ["old", "</script>"]
    assert len(scene["turns"]) == len(scene["parents"]) == len(first.skeleton.names)
    np.testing.assert_allclose(scene["turns"], features.local_quaternions(first)[0], atol=1e-5)
    np.testing.assert_allclose(scene["place"], first.positions[0, 0], atol=1e-5)
    np.testing.assert_allclose(np.array(scene["offsets"])[1:], scene["unit"] * first.positions[0, 1:], atol=1e-4)
