"""SVG, SRVP and SLAMP as components: their promises, their chance, and that samples are streamed."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import street
import torch

from geovp_classic import registry
from geovp_classic.errors import BadData
from geovp_classic.types import Context, PrivilegedInput
from geovp_learned import checkpoints
from geovp_learned.checkpoints import shipped
from geovp_learned.video import prediction
from geovp_learned.video.prediction import VideoPredictor, noise_of
from geovp_learned.video.training import VideoTraining


@pytest.fixture
def checkpoint(name: str, method: VideoTraining, tmp_path: Path) -> Path:
    torch.manual_seed(0)
    file, networks = tmp_path / f"{name}.safetensors", method.build()
    with torch.no_grad():
        for parameter in networks["video"].parameters():
            parameter.mul_(3.0)  # so that latents matter before anything is learnt
    checkpoints.write(file, name, method, networks, {})
    return file


@pytest.fixture
def predictor(name: str, checkpoint: Path) -> VideoPredictor:
    return registry.build("predictors", {"name": name, "weights": str(checkpoint)})


def context(num_past: int = 6) -> Context:
    return street.clip().split(num_past, PrivilegedInput.NONE)[0]


def test_samples_depend_on_their_seed_and_not_on_how_many_are_asked_for(
    predictor: VideoPredictor, monkeypatch: pytest.MonkeyPatch
) -> None:
    many = predictor.predict(context(), num_samples=7).frames
    monkeypatch.setattr(prediction, "CPU_PIXELS", 1)  # one sample at a time
    few = predictor.predict(context(), num_samples=2).frames
    assert many.shape == (7, 4, 128, 128, 3)
    # As many at once may round the last bit otherwise, which can tip a grey level.
    assert np.abs(many[:2].astype(int) - few).max() <= 2
    assert np.abs(many[0].astype(int) - many[6]).mean() > 0.02  # samples differ
    assert (replace(predictor, seed=1).predict(context(), num_samples=2).frames != few).any()


def test_every_clip_has_its_own_chance() -> None:
    here = context()
    there = replace(context(num_past=5), times_s=here.times_s[1:])
    assert not torch.equal(noise_of(here, 0, 1, 4), noise_of(there, 0, 1, 4))


def test_frames_of_any_size_come_back_as_they_went_in(predictor: VideoPredictor) -> None:
    whole = context()
    wide = replace(
        whole,
        frames=whole.frames[:, 32:96].copy(),
        intrinsics=whole.intrinsics.cropped(0, 32, 128, 64),
    )
    assert predictor.predict(wide).frames.shape == (1, 4, 64, 128, 3)


def test_no_more_frames_are_looked_at_than_in_training(predictor: VideoPredictor) -> None:
    """The method was trained on three observed frames; the context has six."""
    whole = context()
    early, late = whole.frames.copy(), whole.frames.copy()
    early[:3], late[3] = 0, 0
    shown = predictor.predict(whole).frames
    np.testing.assert_array_equal(shown, predictor.predict(replace(whole, frames=early)).frames)
    assert (shown != predictor.predict(replace(whole, frames=late)).frames).any()


def test_descriptions_tell_which_weights_and_others_are_refused(
    name: str, method: VideoTraining, checkpoint: Path, predictor: VideoPredictor
) -> None:
    before, shown = registry.describe(predictor), predictor.predict(context()).frames
    assert registry.build("predictors", before) == predictor
    torch.manual_seed(1)
    checkpoints.write(
        checkpoint, name, method, method.build(), {}
    )  # another network under the same name
    asked = {key: value for key, value in before.items() if key != "fingerprint"}
    other = registry.build("predictors", asked)
    assert registry.describe(other) == {**asked, "fingerprint": other.fingerprint}
    assert other.fingerprint != before["fingerprint"]
    assert (
        other.predict(context()).frames != shown
    ).any()  # not the network that was loaded before
    found, wanted = other.fingerprint, before["fingerprint"]
    sentence = f"{checkpoint} has the fingerprint {found}, expected {wanted}: give the weights"
    with pytest.raises(BadData, match=f"^predictors: {sentence}"):
        registry.build("predictors", before)


def test_the_papers_name_alone_asks_for_weights(name: str) -> None:
    with pytest.raises(BadData, match=f"{name} stands for .*: give weights = PATH"):
        registry.build("predictors", name)


def test_the_shipped_weights_predict_and_their_samples_differ(name: str) -> None:
    assert shipped(f"{name}-tiny").stat().st_size < 8e6
    own = registry.build("predictors", f"{name}-tiny")
    frames = own.predict(context(), num_samples=2).frames.astype(int)
    assert np.abs(frames[0] - frames[1]).max() >= 1
    change = np.abs(frames[0, 0] - context().frames[-1]).mean()
    assert change < 40  # grey levels: the next frame resembles the last one
