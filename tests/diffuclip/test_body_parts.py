"""Body parts: the partition, masks that add up to one, Eq. 19 against its letter, finite where parts agree."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from zeggs_jax.diffuclip import body_parts
from zeggs_jax.motion.skeleton import REFERENCE_NAMES, REFERENCE_PARENTS, Skeleton

ZEGGS = Skeleton(REFERENCE_NAMES, REFERENCE_PARENTS, np.ones((75, 3)))
MASKS = np.repeat(np.eye(2, dtype=bool), 3, axis=1)


def test_the_partition_of_the_zeggs_body():
    upper, lower = (body_parts.joints(ZEGGS, part) for part in ("upper", "lower"))
    names = {ZEGGS.names[joint] for joint in lower}
    assert names == {"Hips", *(name for name in ZEGGS.names if "Leg" in name or "Foot" in name or "Toe" in name)}
    assert sorted([*upper, *lower]) == list(range(75))


def test_what_hangs_on_the_hips_without_spine_head_or_hand_is_lower():
    body = Skeleton(("Root", "Hips", "Tail", "Spine", "Head", "LeftUpLeg"), (-1, 0, 1, 1, 3, 1), np.ones((6, 3)))
    assert [body.names[joint] for joint in body_parts.joints(body, "upper")] == ["Spine", "Head"]
    assert [body.names[joint] for joint in body_parts.joints(body, "lower")] == ["Root", "Hips", "Tail", "LeftUpLeg"]


def test_every_column_belongs_to_one_part_and_the_root_to_the_lower(body):
    upper, lower = body_parts.columns(body, ("upper", "lower"))
    np.testing.assert_array_equal(np.sort(np.concatenate([upper, lower])), np.arange(3 + 6 * len(body)))
    assert {0, 1, 2} <= set(lower)
    head = body.index("Head")
    assert set(range(3 + 6 * head, 9 + 6 * head)) <= set(upper)
    np.testing.assert_array_equal(body_parts.columns(body, ())[0], np.arange(3 + 6 * len(body)))


def test_an_unknown_part_is_told(body):
    with pytest.raises(ValueError, match="'tail' is no part of the body; parts are upper and lower"):
        body_parts.joints(body, "tail")


def test_masks_add_up_to_one(tiny):
    masks = body_parts.masks(tiny)
    assert masks.shape == (2, tiny.latent_size)
    np.testing.assert_array_equal(masks.sum(axis=0), 1)


def predictions(z, prompts):
    """What stands for a network under several prompts: nonlinear, every latent sees the others."""
    mixed = jnp.cumsum(z, axis=0)
    return jnp.stack([jnp.tanh(mixed * p) + p * z for p in prompts])


def latents():
    return jax.random.normal(jax.random.key(0), (5, 6))


def test_equal_prompts_are_one_prompt():
    """Bit by bit, with the gradient too: it is exactly 0 where all predict the same."""
    z = latents()
    for seam in (0.0, 0.01, 10.0):
        made = body_parts.predict(lambda z: predictions(z, (0.7, 0.7)), z, MASKS, seam)
        np.testing.assert_array_equal(made, predictions(z, (0.7,))[0])


def test_each_part_follows_its_own_prompt():
    z = latents()
    made = body_parts.predict(lambda z: predictions(z, (0.3, 0.9)), z, MASKS, 0.0)
    both = predictions(z, (0.3, 0.9))
    np.testing.assert_array_equal(made, np.where(MASKS[0], both[0], both[1]))


def test_the_seam_is_the_gradient_of_the_distances_through_the_network():
    """Against central differences of the sum over i != j of |E_i - E_j| by numpy in float64."""
    z, prompts, seam = latents(), (0.3, 0.9, -0.4), 0.5
    masks = np.repeat(np.eye(3, dtype=bool), 2, axis=1)

    def distance(z):
        mixed = np.cumsum(z, axis=0)
        each = [np.tanh(mixed * p) + p * z for p in prompts]
        return sum(np.linalg.norm(a - b) for i, a in enumerate(each) for j, b in enumerate(each) if i != j)

    exact, step = np.zeros(z.shape), 1e-5
    for at in np.ndindex(*z.shape):
        moved = np.zeros(z.shape)
        moved[at] = step
        exact[at] = (distance(np.float64(z) + moved) - distance(np.float64(z) - moved)) / (2 * step)
    made = body_parts.predict(lambda z: predictions(z, prompts), z, masks, seam)
    plain = body_parts.predict(lambda z: predictions(z, prompts), z, masks, 0.0)
    np.testing.assert_allclose(made - plain, seam * exact, atol=1e-4)


def test_the_gradient_is_finite_and_zero_where_parts_agree():
    noises = jnp.ones((2, 4, 6))
    value, slope = jax.value_and_grad(body_parts.smoothness)(noises)
    assert value == 0.0
    np.testing.assert_array_equal(slope, 0.0)
    near = jax.grad(body_parts.smoothness)(noises.at[0].add(1e-7))
    assert np.isfinite(near).all()
    assert np.abs(near).max() <= 2.0


def test_a_step_against_the_seam_brings_predictions_together():
    z = latents()
    both = lambda z: predictions(z, (0.3, 0.9))  # noqa: E731
    slope = jax.grad(lambda z: body_parts.smoothness(both(z)))(z)
    assert body_parts.smoothness(both(z - 0.01 * slope)) < body_parts.smoothness(both(z))
