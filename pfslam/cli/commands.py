"""The commands of the command line; each takes the parsed arguments and writes files."""

from __future__ import annotations

import argparse
import io
import json
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
import numpy.ma  # NumPy would load these two in the middle of a run,
import numpy.random  # and a Ctrl-C that comes during an import can be lost
from tqdm import tqdm

from pfslam.beyond.localization import LocalizationConfig, locate
from pfslam.cli.lab import lab_command
from pfslam.cli.look import check_table, describe, topic_table
from pfslam.cli.search import closing_words_of_search, picture_of_search, summarise_search
from pfslam.cli.summary import closing_words, said_by_the_loader, summarise
from pfslam.errors import DataError
from pfslam.evaluation.checkup import check_up
from pfslam.io.bags import BagOptions, choose_topics, is_bag, read_topics
from pfslam.io.course import save_course
from pfslam.io.datasets import dataset_name, load
from pfslam.io.files import atomic_write, check_writable, write_text
from pfslam.io.formats import read_known_map, write_covariances, write_map, write_texture, write_tum
from pfslam.io.images import write_png
from pfslam.io.log import Log
from pfslam.io.recordings import save
from pfslam.motion import dead_reckoning
from pfslam.poses import Trajectory
from pfslam.recording import Recording
from pfslam.run import SlamResult, run_slam
from pfslam.settings import changed, plain, type_hints
from pfslam.simulator import Hazards, simulate
from pfslam.simulator.cache import cached_simulation
from pfslam.slam import PRESETS
from pfslam.study import read_study, run_study
from pfslam.study.table import read_table
from pfslam.texture import FloorTexture, map_texture

if TYPE_CHECKING:
    from pfslam.beyond.loops.closing import Revision

FIGURES = (
    "dead_reckoning_trajectory",
    "prediction_only",
    "dead_reckoning_map",
    "slam_map",
    "slam_trajectory",
    "texture_map",
)


def progress_bar(what: str) -> Callable:
    """Make a progress bar on the error stream that appears if the work lasts more than two seconds."""
    often = 0.1 if sys.stderr.isatty() else 5.0
    return partial(
        tqdm, desc=what, delay=2.0, mininterval=often, leave=False, file=sys.stderr, dynamic_ncols=True
    )


class Stopwatch:
    """Measures the seconds of each stage of a run."""

    def __init__(self) -> None:
        self.seconds: dict[str, float] = {}

    @contextmanager
    def stage(self, name: str) -> Iterator[None]:
        begin = time.perf_counter()
        yield
        self.seconds[name] = round(time.perf_counter() - begin, 3)


def simulate_command(arguments: argparse.Namespace) -> None:
    """Write ``hall`` as set 20, ``ramp`` as 21 or ``ring`` as 95, with truth and, if asked for, images."""
    chosen = {name: getattr(arguments, name) for name in type_hints(Hazards)}
    hazards = changed(Hazards(), {k: v for k, v in chosen.items() if v is not None}, "simulate", "--")
    check_writable(arguments.out)
    bar = progress_bar("simulating")
    if arguments.seed is None and hazards == Hazards():
        simulation = cached_simulation(arguments.name, bar)
    else:
        simulation = simulate(arguments.name, arguments.seed, progress=bar, hazards=hazards)
    number = simulation.config.number
    extras = {name: getattr(simulation, name) for name in ("z", "pitch", "roll")}
    bar = progress_bar("images")
    save_course(
        simulation.recording, number, arguments.out, arguments.images, truth_extras=extras, progress=bar
    )
    print(f"set {number} ({arguments.name}) is in {arguments.out}")


def run_command(arguments: argparse.Namespace) -> None:
    """Run dead reckoning, the filter and the texture of one data set; all results go to one folder."""
    chosen = {"particles": arguments.particles, "every": arguments.every}
    given = {name: value for name, value in chosen.items() if value is not None}
    config = changed(PRESETS[arguments.method](), given, "pfslam run")
    out, watch = out_folder(arguments), Stopwatch()
    with watch.stage("load"):
        recording = load_dataset(arguments)
    wants_texture = has_images(recording) if arguments.texture is None else arguments.texture
    check_wishes(recording, wants_texture, arguments.loops)
    check_writable(out)
    with watch.stage("dead_reckoning"):
        odometry = dead_reckoning(recording)
    result, texture, revision = None, None, None
    if recording.lidar is not None:
        with watch.stage("slam"):
            rng = np.random.default_rng(arguments.seed)
            result = run_slam(recording, config, rng=rng, progress=progress_bar("SLAM"), keep_particles=False)
        if arguments.loops:
            from pfslam.beyond.loops.closing import close_loops  # SciPy takes a while to load

            with watch.stage("loops"):
                revision = close_loops(recording, result)
        if wants_texture:
            with watch.stage("texture"):
                bar = progress_bar("texture")
                texture = map_texture(recording, result.trajectory, result.grid, progress=bar)
        # At the stamps of the estimate, so that the two files compare line by line.
        odometry = Trajectory(result.trajectory.t, odometry.at(result.trajectory.t))
    with watch.stage("write"):
        files = write_results(out, odometry, result, texture, revision)
    summary = summarise(recording, odometry, result, texture, revision)
    about = {"dataset": recording.name, "method": arguments.method, "seed": arguments.seed}
    ran = config if result is None else result.config
    config_used = replace(ran, every=ran.every or recording.default_every)
    about |= {"config": config_used.as_dict(), "seconds": watch.seconds, "files": files}
    write_text(out / "summary.json", json.dumps(plain(about | summary), indent=2, allow_nan=False) + "\n")
    print(closing_words(recording, summary, out))


def check_wishes(recording: Recording, texture: bool, loops: bool) -> None:
    """Raise ``DataError`` for a run that is asked for what its data set cannot give."""
    if texture and not has_images(recording):
        raise DataError(recording.name, "--texture", "no images", "a data set with disparity and RGB images")
    if loops and recording.lidar is None:
        raise DataError(recording.name, "--loops", "no LiDAR", "a data set with scans")


def info_command(arguments: argparse.Namespace) -> None:
    """Print what a data set holds and what a run would use."""
    path = Path(arguments.dataset)
    if path.exists() and is_bag(path):
        topics = read_topics(path)
        used: list[str] = []
        with suppress(DataError):  # which is said when the bag is loaded
            used += choose_topics(Log(path), topics, bag_options(arguments)).values()
        print(topic_table(topics, used), end="\n\n", flush=True)
    print(describe(load_dataset(arguments)))


def check_command(arguments: argparse.Namespace) -> int:
    """Print the check-up of a data set; the exit code is 1 if a check failed."""
    recording = load_dataset(arguments)
    findings = check_up(recording)
    failed = sum(finding.ok is False for finding in findings)
    print(check_table(findings), *said_by_the_loader(recording), sep="\n")
    print(f"{failed} of {len(findings)} checks failed" if failed else "no check failed")
    return 1 if failed else 0


def convert_command(arguments: argparse.Namespace) -> None:
    """Write a data set into one file that loads without ROS."""
    recording = load_dataset(arguments)
    save(recording, arguments.out, images=arguments.images, progress=progress_bar("writing"))
    for line in said_by_the_loader(recording):
        print(line)
    print(f"the recording is in {arguments.out}")


def load_dataset(arguments: argparse.Namespace) -> Recording:
    """Load the data set that the command line names."""
    bar = progress_bar("simulating")
    return load(arguments.dataset, arguments.data, bag=bag_options(arguments), progress=bar)


def bag_options(arguments: argparse.Namespace) -> BagOptions:
    """Collect what the command line says about a bag."""
    place = None if arguments.lidar_at is None else tuple(arguments.lidar_at)
    named = {name: getattr(arguments, name) for name in ("scan", "odom", "imu", "rgb", "depth")}
    return BagOptions(**named, lidar_at=place)


def out_folder(arguments: argparse.Namespace) -> Path:
    """Choose where results go: as asked for, else out/DATASET."""
    return arguments.out if arguments.out is not None else Path("out") / dataset_name(arguments.dataset)


def has_images(recording: Recording) -> bool:
    """Tell whether a recording has at least one image of each kind."""
    camera = recording.camera
    return camera is not None and len(camera.disparity_index) > 0 and len(camera.rgb_index) > 0


def write_results(
    out: Path,
    odometry: Trajectory,
    result: SlamResult | None,
    texture: FloorTexture | None,
    revision: Revision | None = None,
) -> list[str]:
    """Write what there is, and return the names of the files, the summary included."""
    write_tum(out / "odometry.tum", odometry)
    files = ["odometry.tum"]
    if result is not None:
        write_tum(out / "trajectory.tum", result.trajectory)
        write_map(out / "map.yaml", result.grid)
        files += ["trajectory.tum", "map.pgm", "map.yaml"]
        if result.covariances is not None:
            write_covariances(out / "trajectory_covariance.txt", result.trajectory.t, result.covariances)
            files.append("trajectory_covariance.txt")
    if revision is not None:
        write_tum(out / "trajectory_revised.tum", revision.trajectory)
        write_map(out / "map_revised.yaml", revision.grid)
        files += ["trajectory_revised.tum", "map_revised.pgm", "map_revised.yaml"]
    if texture is not None:
        write_texture(out / "texture.yaml", texture.spec, texture.rgb, texture.seen)
        files += ["texture.png", "texture.yaml"]
    return [*files, "summary.json"]


def locate_command(arguments: argparse.Namespace) -> None:
    """Find the robot of a data set in a known map; trajectory, summary and a picture go to one folder."""
    config = LocalizationConfig()
    if arguments.particles is not None:
        most = arguments.particles
        config = replace(config, first=10 * most, particles=most, least=min(config.least, most))
    grid, watch = read_known_map(arguments.map), Stopwatch()
    out = arguments.out or Path("out") / f"{dataset_name(arguments.dataset)}-located"
    with watch.stage("load"):
        recording = load_dataset(arguments)
    check_writable(out)
    with watch.stage("locate"):
        rng = np.random.default_rng(arguments.seed)
        bar = progress_bar("locating")
        result = locate(grid, recording, config, rng=rng, progress=bar, keep_particles=False)
    write_tum(out / "trajectory.tum", result.trajectory)
    write_png(out / "located.png", picture_of_search(grid, result))
    about = {"map": str(arguments.map), "dataset": recording.name, "seed": arguments.seed}
    about |= {"config": replace(config, every=config.every or recording.default_every)}
    about |= {"seconds": watch.seconds, "files": ["trajectory.tum", "located.png", "summary.json"]}
    summary = about | summarise_search(recording, result)
    write_text(out / "summary.json", json.dumps(plain(summary), indent=2, allow_nan=False) + "\n")
    print(closing_words_of_search(recording, result, out))


def report_command(arguments: argparse.Namespace) -> None:
    """Draw the report's figures as PNG files."""
    try:
        from pfslam_book.show.figures import report_figures
    except ImportError as error:
        found, extra = f"no {error.name}", "the extra: pip install pfslam[plots]"
        raise DataError("pfslam report", "package", found, extra) from error
    out = out_folder(arguments)
    recording = load_dataset(arguments)
    check_writable(out)
    figures = report_figures(recording, seed=0, progress=progress_bar("figures"))
    for name in FIGURES:
        if name in figures:
            buffer = io.BytesIO()
            figures[name].savefig(buffer, format="png", dpi=150, bbox_inches="tight")
            with atomic_write(out / f"{name}.png") as file:
                file.write(buffer.getvalue())
    print(f"{len(figures)} figures are in {out}")


def study_command(arguments: argparse.Namespace) -> None:
    """Make the runs of a study that are missing, and its table."""
    study = read_study(arguments.file)
    out = arguments.out if arguments.out is not None else Path("out") / study.name
    path = run_study(study, out, jobs=arguments.jobs, progress=progress_bar("runs"))
    errors = read_table(path)["error"]
    failed = int(np.count_nonzero(errors != ""))
    words = f"{failed} of {len(errors)} runs failed, see the column error; " if failed else ""
    print(f"{words}{len(errors)} runs are in {path}")


COMMANDS: dict[str, Callable[[argparse.Namespace], int | None]] = {
    "simulate": simulate_command,
    "info": info_command,
    "check": check_command,
    "run": run_command,
    "locate": locate_command,
    "report": report_command,
    "convert": convert_command,
    "study": study_command,
    "lab": lab_command,
}
