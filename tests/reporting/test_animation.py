"""The animation: a GIF that loops, in the run's own time, small."""

import io
from dataclasses import replace

import numpy as np
import pytest
from PIL import Image

from omniservo.reporting import write_animation
from omniservo.reporting.animation import animation_bytes
from omniservo.results.run_result import Film


@pytest.fixture(scope="module")
def gif(run, tmp_path_factory):
    path = tmp_path_factory.mktemp("film") / "recording.gif"
    write_animation(run, path)
    return path


def test_animation_has_a_picture_for_every_moment_and_loops(gif, run):
    with Image.open(gif) as film:
        assert film.n_frames == len(run.film.times) > 1
        assert film.info["loop"] == 0


def test_animation_runs_in_its_own_time(gif, run):
    with Image.open(gif) as film:
        durations = []
        for k in range(film.n_frames):
            film.seek(k)
            durations.append(film.info["duration"])
    assert sum(durations[:-1]) == pytest.approx(1000.0 * (run.film.times[-1] - run.film.times[0]), rel=0.05)
    assert durations[-1] >= 1000


def test_animation_moves_on_both_sides(gif):
    with Image.open(gif) as film:
        first = np.asarray(film.convert("RGB")).astype(int)
        film.seek(film.n_frames - 1)
        last = np.asarray(film.convert("RGB")).astype(int)
    change = np.abs(last - first).sum(axis=-1)
    assert (change[:270, :400] > 100).sum() > 100
    assert (change[:270, 420:] > 100).sum() > 100


def test_the_page_of_the_animation_is_white(run):
    views = tuple(np.where(view[..., :1] > 127, np.uint8([255, 255, 250]), view) for view in run.film.outside)
    with Image.open(io.BytesIO(animation_bytes(replace(run, film=replace(run.film, outside=views))))) as film:
        assert film.convert("RGB").getpixel((film.width - 1, film.height - 1)) == (255, 255, 255)


@pytest.mark.slow
def test_noise_of_the_camera_costs_few_bytes(made_up_run, tmp_path):
    """Forty pictures of a noisy camera at rest stay far below the limit of 3 MB."""
    run = made_up_run(steps=40)
    rng = np.random.default_rng(0)
    noisy = [(run.final_image + rng.normal(0, 2, run.final_image.shape)).clip(0, 255) for _ in range(40)]
    film = Film(
        tuple(np.linspace(0.0, 4.0, 40).tolist()),
        tuple(image.astype(np.uint8) for image in noisy),
        (run.outside[1],) * 40,
    )
    write_animation(replace(run, film=film), tmp_path / "a.gif")
    assert (tmp_path / "a.gif").stat().st_size < 1_500_000


def test_a_run_stopped_before_its_first_step_gives_one_picture(stopped_run, tmp_path):
    write_animation(stopped_run, tmp_path / "a.gif")
    with Image.open(tmp_path / "a.gif") as film:
        assert film.n_frames == 1
