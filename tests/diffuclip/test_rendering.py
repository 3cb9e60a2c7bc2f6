"""The renderer: where a limb is in the picture, who hides whom, cameras that see what they should."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from zeggs_jax.diffuclip import rendering
from zeggs_jax.diffuclip.rendering import Camera, Figure
from zeggs_jax.motion.skeleton import REFERENCE_NAMES, REFERENCE_PARENTS, Skeleton

RED, BLUE = (1.0, 0.0, 0.0), (0.0, 0.0, 1.0)


def view(azimuth=0.0, elevation=0.0, fill=1.0):
    return Camera(jnp.zeros(3), *map(jnp.asarray, (azimuth, elevation, 400.0, fill)), jnp.ones(3))


def bones(*colours):
    count = len(colours)
    ends = np.arange(2 * count).reshape(count, 2)
    return Figure(ends[:, 0], ends[:, 1], np.full(count, 5.0, np.float32), np.array(colours, np.float32))


def test_a_bone_is_where_it_is_and_as_thick_as_it_is():
    points = jnp.array([[50.0, 0.0, 0.0], [50.0, 60.0, 0.0]])  # 2 m are 100 pixels: 25 to the right, 30 up
    image = np.asarray(rendering.render(points, bones(RED), view(), 100))
    red = image[:, :, 1] < 0.5
    rows, columns = np.nonzero(red)
    assert abs(columns.mean() - 74.5) < 0.6
    assert columns.max() - columns.min() + 1 == pytest.approx(5, abs=1)
    assert (rows.min(), rows.max()) == (pytest.approx(18, abs=1), pytest.approx(52, abs=1))
    assert (image[:, :40] == 1.0).all()


def test_the_nearer_bone_hides_the_other():
    cross = [[-30.0, 0.0, 20.0], [30.0, 0.0, 20.0], [0.0, -30.0, -20.0], [0.0, 30.0, -20.0]]
    points = jnp.array(cross)
    front = rendering.render(points, bones(RED, BLUE), view(), 60)[29, 29]
    behind = rendering.render(points, bones(RED, BLUE), view(np.pi), 60)[29, 29]
    assert front[0] > 0.5 > front[2]
    assert behind[2] > 0.5 > behind[0]


def test_from_the_bodys_left_what_is_ahead_is_on_the_left():
    ahead = jnp.array([[0.0, 0.0, 50.0]])
    place, _ = rendering.project(ahead, view(np.pi / 2))
    assert place[0, 0] < -0.1
    place, depth = rendering.project(jnp.array([[50.0, 0.0, 0.0]]), view(np.pi / 2))
    assert abs(place[0, 0]) < 1e-6
    assert depth[0] == pytest.approx(350.0, abs=1e-3)
    place, _ = rendering.project(ahead, view(0.0, 0.5))  # from above, what is ahead is lower
    assert place[0, 1] < -0.05


def test_random_cameras_see_the_whole_body():
    body = jnp.array([[0.0, 85.0, 0.0], [0.0, -90.0, 0.0], [60.0, 40.0, 0.0], [-60.0, 40.0, 0.0]])
    keys = jax.random.split(jax.random.key(0), 64)
    cameras = jax.vmap(rendering.camera, (0, None))(keys, jnp.zeros(3))
    places, depths = jax.vmap(rendering.project, (None, 0))(body, cameras)
    assert np.abs(places).max() < 0.55
    assert depths.min() > 100.0
    assert np.std(cameras.azimuth) > 0.5


def test_limbs_of_the_reference_skeleton():
    skeleton = Skeleton(REFERENCE_NAMES, REFERENCE_PARENTS, np.ones((75, 3)))
    shape = rendering.figure(skeleton)
    colour = {skeleton.names[end]: tuple(shape.colour[k].round(2)) for k, end in enumerate(shape.end)}
    assert colour["Spine1"] == colour["Head"] != colour["LeftArm"] == colour["LeftHand"]
    assert len({colour[name] for name in ("Spine1", "LeftArm", "RightArm", "LeftLeg", "RightLeg")}) == 5
    assert "RightHandIndex3" not in colour
    with pytest.raises(ValueError, match="looks like the head"):
        rendering.figure(Skeleton(("Hips", "Tail"), (-1, 0), np.ones((2, 3))))


def test_a_limb_in_the_camera_is_finite():
    points = jnp.array([[0.0, 0.0, 399.0], [0.0, 0.0, 900.0]])
    assert np.isfinite(rendering.render(points, bones(RED), view(), 8)).all()
