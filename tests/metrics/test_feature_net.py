"""The frozen net: reproducible to the bit, knows its data, comes back from its file, refuses what it does not know."""

from dataclasses import replace

import numpy as np
import pytest

from zeggs_jax.metrics import feature_net, net_file
from zeggs_jax.metrics.feature_net import FeatureNetConfig
from zeggs_jax.motion.skeleton import Roles, Skeleton

TINY = FeatureNetConfig(features=4, channels=8, steps=60, batch=8, stride=8)


@pytest.fixture(scope="module")
def truth(gesture):
    return [gesture(seed, seconds=6.0) for seed in range(3)]


@pytest.fixture(scope="module")
def net(truth):
    return feature_net.train(truth, TINY)


def test_the_same_motions_in_any_order_give_the_same_net(net, truth):
    again = feature_net.train(truth[::-1], TINY)
    assert again.fingerprint == net.fingerprint
    assert again.data_hash == net.data_hash
    np.testing.assert_array_equal(feature_net.embed(again, truth[0]), feature_net.embed(net, truth[0]))


def test_another_seed_or_other_data_are_another_net(net, truth, gesture):
    other = feature_net.train(truth, replace(TINY, seed=1))
    assert other.fingerprint != net.fingerprint
    nudged = truth[0].positions.copy()
    nudged[3, 9, 0] += 0.5
    changed = feature_net.train([truth[0]._replace(positions=nudged), *truth[1:]], TINY)
    assert changed.data_hash != net.data_hash
    rounding = truth[0]._replace(positions=truth[0].positions + 1e-9)
    assert feature_net.train([rounding, *truth[1:]], TINY).data_hash == net.data_hash


def test_training_learns_and_more_of_it_learns_more(net, truth):
    longer = feature_net.train(truth, replace(TINY, steps=400))
    assert longer.error < 0.95 * min(net.error, net.spread)


def test_units_do_not_matter(truth):
    """Centimetres by 16, so that no rounding comes in: the same features, an error 16 times as large."""
    big = truth[0]._replace(positions=16.0 * truth[0].positions)
    one, other = (feature_net.train([motion], replace(TINY, stride=4)) for motion in (truth[0], big))
    assert other.error == 16.0 * one.error
    np.testing.assert_array_equal(feature_net.embed(other, big), feature_net.embed(one, truth[0]))


def test_windows_hold_two_seconds_every_half_second_in_their_own_heading(truth):
    found = feature_net.windows(FeatureNetConfig(), truth[0])
    assert found.shape == (9, 32, 13 * 3)
    hips = found.reshape(9, 32, 13, 3)[:, :, 0]
    np.testing.assert_allclose(hips.mean(axis=1)[:, [0, 2]], 0.0, atol=1e-9)


def test_it_comes_back_from_its_file(net, truth, tmp_path):
    np.savez(tmp_path / "net.npz", **net_file.pack(net))
    with np.load(tmp_path / "net.npz") as arrays:  # without pickle
        back = net_file.unpack(dict(arrays))
    assert back.config == net.config
    assert back[1:2] + back[5:] == net[1:2] + net[5:]
    assert back.fingerprint == net.fingerprint
    np.testing.assert_array_equal(feature_net.embed(back, truth[1]), feature_net.embed(net, truth[1]))


def test_a_changed_or_foreign_file_is_refused(net):
    arrays = net_file.pack(net)
    touched = {**arrays, "params/in0/weight": arrays["params/in0/weight"] + 1e-3}
    with pytest.raises(ValueError, match="not those that it was written with"):
        net_file.unpack(touched)
    with pytest.raises(ValueError, match="'header' or 'mean' is missing"):
        net_file.unpack({"x": np.zeros(3)})
    aged = {**arrays, "header": np.array(str(arrays["header"]).replace('"format": 1', '"format": 9'))}
    with pytest.raises(ValueError, match="format 9"):
        net_file.unpack(aged)


def test_motion_that_it_cannot_read_is_refused(net, truth, gesture):
    with pytest.raises(ValueError, match=r"1\.\d s is shorter than the feature net's window of 2 s"):
        feature_net.embed(net, gesture(seconds=1.5))
    old = truth[0].skeleton
    names = tuple("Nose" if name == "Head" else name for name in old.names)
    roles = Roles("Hips", "Spine2", "Nose", "LeftHand", "RightHand", "LeftFoot", "RightFoot")
    with pytest.raises(ValueError, match="first difference: Nose; train a net"):
        feature_net.embed(net, truth[0]._replace(skeleton=Skeleton(names, old.parents, old.offsets, roles)))
    with pytest.raises(ValueError, match="5 windows are too few for 4 features"):
        feature_net.train([gesture(seconds=4.0)], TINY)
    with pytest.raises(ValueError, match="no motion"):
        feature_net.train([], TINY)
    still = truth[0]._replace(positions=np.zeros_like(truth[0].positions))
    with pytest.raises(ValueError, match="stand still"):
        feature_net.train([still], TINY)


def test_settings_that_make_no_net_are_refused():
    with pytest.raises(ValueError, match="multiple of 4"):
        FeatureNetConfig(frames=30)
    with pytest.raises(ValueError, match="'features' of the feature net is 0"):
        FeatureNetConfig(features=0)
