"""The commands: each takes the parsed arguments and writes files. ``NAME_command`` is ``pfslam NAME``."""

from __future__ import annotations

import json
import os
import sys
import time
import warnings
from argparse import Namespace
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from dataclasses import asdict, replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import numpy.ma  # NumPy would load these two in the middle of a run,
import numpy.random  # and a Ctrl-C that comes during an import can be lost
from tqdm import tqdm

from pfslam.beyond.localization import locate
from pfslam.cli import words
from pfslam.cli.figures import picture_of_search, report_figures
from pfslam.cli.lab import lab_command as lab_command
from pfslam.cli.page import Clouds, Outcome, write_pictures
from pfslam.cli.parser import DOUBTED, FAULT, HAZARDS, SPOILED, TOPICS, build_parser
from pfslam.cli.requested import CORRECTED, given, requested_run, requested_search, selected, selection
from pfslam.errors import DataError, need
from pfslam.evaluation.checkup import Finding
from pfslam.evaluation.corrections import NEUTRAL, find_corrections
from pfslam.io.bags import BagOptions, choose_topics
from pfslam.io.course import save_course
from pfslam.io.datasets import dataset_name, is_bag, load
from pfslam.io.files import atomic_write, check_writable, write_png
from pfslam.io.formats import read_known_map, write_covariances, write_map, write_texture, write_tum
from pfslam.io.loading import Log
from pfslam.io.recordings import save
from pfslam.io.results import SUMMARY, check_free, results_in, write_summary
from pfslam.io.selection import select
from pfslam.io.topics import list_topics
from pfslam.motion import dead_reckoning
from pfslam.poses import Trajectory
from pfslam.recording import Recording
from pfslam.refined.floor import map_texture
from pfslam.refined.health import in_doubt
from pfslam.refined.run import judged
from pfslam.refined.scan_odometry import with_scan_odometry
from pfslam.run import run_slam
from pfslam.settings import changed, plain

MOSTLY = 0.5
"""Share of a drive in doubt from which its result is not to be trusted as a whole."""


def progress_bar(what: str, quiet: bool = False) -> Callable:
    """Make a progress bar on the error stream that appears if the work lasts more than two seconds, unless quiet."""
    often = 0.1 if sys.stderr.isatty() else 5.0
    look = {"delay": 2.0, "mininterval": often, "leave": False, "dynamic_ncols": True, "disable": quiet}
    return partial(tqdm, desc=what, file=sys.stderr, **look)


@contextmanager
def timed(seconds: dict[str, float], stage: str) -> Iterator[None]:
    """Measure the seconds of a stage of a run."""
    begin = time.perf_counter()
    yield
    seconds[stage] = round(time.perf_counter() - begin, 3)


def load_dataset(arguments: Namespace) -> Recording:
    """Load the data set that the command line names, or the part of it that is wanted, as it is stated to be."""
    return select(load_whole(arguments), **selected(arguments))


def load_whole(arguments: Namespace) -> Recording:
    """Load the whole data set that the command line names."""
    bar = progress_bar("loading", getattr(arguments, "quiet", False))
    options, named = bag_options(arguments), arguments.odom or arguments.odom_frame
    if named and not options.odometry:
        raise DataError(arguments.dataset, "--no-odometry", f"{named} as well", "one of the two")
    return load(arguments.dataset, arguments.data, bag=options, odometry=options.odometry, progress=bar)


def load_moving(arguments: Namespace, whole: Recording) -> Recording:
    """Return what is wanted of the whole data set; where nothing else tells how the robot moved, its scans do."""
    recording = select(whole, **selected(arguments))
    if recording.motion != "scans":
        return recording
    return with_scan_odometry(recording, progress_bar("matching", getattr(arguments, "quiet", False)))


def load_corrected(arguments: Namespace) -> tuple[Recording, list[Finding]]:
    """Load what is wanted of a data set and put right what it says itself; also return its check-up.

    Its notes then tell what was put right, and the arguments state it, so that ``selection`` keeps it.
    """
    whole = load_whole(arguments)
    recording = load_moving(arguments, whole)
    known = {name for name, option in CORRECTED.items() if getattr(arguments, option) not in (None, "auto")}
    found, lines, findings = find_corrections(recording, known, whole)
    if found:
        for name in CORRECTED.keys() - known:
            setattr(arguments, CORRECTED[name], (NEUTRAL | found)[name])
        recording = load_moving(arguments, whole)
    return replace(recording, notes=(*recording.notes, *lines)), findings


def bag_options(arguments: Namespace) -> BagOptions:
    """Collect what the command line says about a bag."""
    place = None if arguments.lidar_at is None else tuple(arguments.lidar_at)
    topics = {name: getattr(arguments, name) for name in TOPICS}
    heights = None if arguments.slice is None else tuple(arguments.slice)
    stated = {"odom_frame": arguments.odom_frame, "odometry": arguments.no_odometry is None}
    return BagOptions(**topics, **stated, lidar_at=place, slice=heights)


def out_folder(arguments: Namespace, suffix: str = "") -> Path:
    """Choose where results go: as asked for, else out/DATASET."""
    return arguments.out or Path("out") / f"{dataset_name(arguments.dataset)}{suffix}"


def simulate_command(arguments: Namespace) -> None:
    """Write ``hall`` as set 20, ``ramp`` as 21 or ``ring`` as 95, with truth and, if asked for, images."""
    from pfslam.simulator import Hazards, simulate  # which other commands can do without
    from pfslam.simulator.cache import cached_simulation

    hazards = changed(Hazards(), given(arguments, "people", "sweep", *HAZARDS), "simulate", "--")
    check_writable(arguments.out)
    bar = progress_bar("simulating")
    if arguments.seed is None and hazards == Hazards():
        simulation = cached_simulation(arguments.name, bar)
    else:
        simulation = simulate(arguments.name, arguments.seed, progress=bar, hazards=hazards)
    number, recording = simulation.config.number, simulation.recording
    extras, bar = {name: getattr(simulation, name) for name in ("z", "pitch", "roll")}, progress_bar("images")
    with results_in(arguments.out, "simulate", arguments.force) as folder:
        save_course(recording, number, folder, arguments.images, truth_extras=extras, progress=bar)
    print(f"set {number} ({arguments.name}) is in {arguments.out}")


def run_command(arguments: Namespace) -> int:
    """Run dead reckoning, the filter and the texture of a data set, unless its check-up finds what would spoil them."""
    method, seed, again, config = requested_run(arguments)
    arguments.quiet |= arguments.json
    out, seconds = out_folder(arguments), dict[str, float]()
    with timed(seconds, "load"):
        recording, findings = load_corrected(arguments)
    wants_texture = has_images(recording) if arguments.texture is None else arguments.texture
    check_possible(recording, wants_texture, arguments.loops)
    check_writable(out)
    check_free(out, files_of_run(recording, wants_texture, arguments.loops), "run", arguments.force)
    if words.stops(findings) and not arguments.anyway:
        return stopped(findings)
    with timed(seconds, "dead_reckoning"):
        odometry = dead_reckoning(recording)
    result, texture, revision = None, None, None
    rng, clouds = np.random.default_rng(seed), Clouds(progress_bar("SLAM", arguments.quiet))
    if recording.lidar is not None:
        with timed(seconds, "slam"):
            found = run_slam(
                recording, config, rng=rng, progress=clouds, keep_particles=False, second_look=again
            )
            result = judged(recording, found)
        if arguments.loops:
            from pfslam.beyond.loops.closing import close_loops  # SciPy takes a while to load

            with timed(seconds, "loops"):
                revision = close_loops(recording, result)
        if wants_texture:
            with timed(seconds, "texture"):
                bar = progress_bar("texture", arguments.quiet)
                texture = map_texture(recording, result.trajectory, result.grid, progress=bar)
        # At the stamps of the estimate, so that the two files compare line by line.
        odometry = Trajectory(result.trajectory.t, odometry.at(result.trajectory.t))
    kept = config if result is None else result.config
    about = {"command": arguments.line, "dataset": recording.name, "method": method, "seed": seed}
    about |= {"second_look_allowed": again, "selection": selection(arguments)}
    about |= {"config": replace(kept, every=kept.every or recording.default_every).as_dict()}
    outcome = Outcome(recording, odometry, result, texture, revision)
    return finished(arguments, out, about, seconds, outcome, findings, clouds)


def finished(
    arguments: Namespace, out: Path, about: dict, seconds: dict, outcome: Outcome, findings, clouds
) -> int:
    """Write and tell what came out of a run, and return the exit code."""
    summary = words.summarise(*outcome, findings)
    with results_in(out, "run", arguments.force) as folder:
        with timed(seconds, "write"):
            files = write_results(folder, *outcome[1:])
            files += write_pictures(folder, about | summary, outcome, clouds)
        text = write_summary(
            folder, "run", about | {"seconds": seconds, "files": [*files, SUMMARY]} | summary
        )
    if arguments.json:
        print(text, end="")
    elif not arguments.quiet:
        print(words.closing_words(outcome.recording, summary, out), words.to_look_at(files, out), sep="\n")
    return DOUBTED if in_doubt(summary["distrust"], outcome.odometry.t).mean() > MOSTLY else 0


def stopped(findings: list[Finding]) -> int:
    """Say what makes a run impossible, and return the exit code of a run that is not begun."""
    lines = [*words.stops(findings), "nothing was run; add --anyway to run all the same"]
    print(*(f"pfslam: {line}" for line in lines), sep="\n", file=sys.stderr)
    return SPOILED


def has_images(recording: Recording) -> bool:
    """Return whether a recording has at least one image of each kind."""
    camera = recording.camera
    return camera is not None and len(camera.disparity_index) > 0 and len(camera.rgb_index) > 0


def check_possible(recording: Recording, texture: bool, loops: bool) -> None:
    """Raise ``DataError`` for a run that is asked for what its data set cannot give."""
    if texture and not has_images(recording):
        raise DataError(recording.name, "--texture", "no images", "a data set with disparity and RGB images")
    if loops and recording.lidar is None:
        raise DataError(recording.name, "--loops", "no LiDAR", "a data set with scans")


def files_of_run(recording: Recording, texture: bool, loops: bool) -> list[str]:
    """List the names of the files that a run may write."""
    names = ["odometry.tum", "index.html", SUMMARY]
    for suffix in () if recording.lidar is None else ("", "_revised") if loops else ("",):
        names += [f"trajectory{suffix}.tum", *(f"map{suffix}.{kind}" for kind in ("pgm", "yaml", "png"))]
    names += [] if recording.lidar is None else ["trajectory_covariance.txt"]
    return names + (["texture.png", "texture.yaml"] if texture else [])


def write_results(out: Path, odometry: Trajectory, result, texture, revision) -> list[str]:
    """Write what there is of a run, and return the names of the files."""
    write_tum(out / "odometry.tum", odometry)
    files = ["odometry.tum"]
    for part, suffix in ((result, ""), (revision, "_revised")):
        if part is not None:
            write_tum(out / f"trajectory{suffix}.tum", part.trajectory)
            write_map(out / f"map{suffix}.yaml", part.grid)
            files += [f"trajectory{suffix}.tum", f"map{suffix}.pgm", f"map{suffix}.yaml"]
    if result is not None and result.covariances is not None:
        write_covariances(out / "trajectory_covariance.txt", result.trajectory.t, result.covariances)
        files.append("trajectory_covariance.txt")
    if texture is not None:
        write_texture(out / "texture.yaml", texture.spec, texture.rgb, texture.seen)
        files += ["texture.png", "texture.yaml"]
    return files


def locate_command(arguments: Namespace) -> int:
    """Find the robot of a data set in a known map; trajectory, summary and a picture go to one folder.

    The exit code is 1 if it was not found.
    """
    seed, config = requested_search(arguments)
    grid, seconds = read_known_map(arguments.map), dict[str, float]()
    out, files = out_folder(arguments, "-located"), ["trajectory.tum", "located.png", SUMMARY]
    check_writable(out)
    with timed(seconds, "load"):
        recording, _ = load_corrected(arguments)
    check_free(out, files, "locate", arguments.force)
    with timed(seconds, "locate"):
        rng, bar = np.random.default_rng(seed), progress_bar("locating")
        result = locate(grid, recording, config, rng=rng, progress=bar, keep_particles=False)
    about = {"map": str(arguments.map), "dataset": recording.name, "seed": seed}
    about |= {"selection": selection(arguments)}
    about |= {"config": replace(config, every=config.every or recording.default_every)}
    about |= {"seconds": seconds, "files": files} | words.summarise_search(recording, result)
    with results_in(out, "locate", arguments.force) as folder:
        write_tum(folder / "trajectory.tum", result.trajectory)
        write_png(folder / "located.png", picture_of_search(grid, result))
        text = write_summary(folder, "locate", about)
    print(text.rstrip() if arguments.json else words.closing_words_of_search(recording, result, out))
    return 0 if result.found else FAULT


def info_command(arguments: Namespace) -> None:
    """Print what a data set holds and what a run would use."""
    path, listed, used = Path(arguments.dataset), dict[str, tuple[str, int]](), list[str]()
    if path.exists() and is_bag(path):
        listed = list_topics(path)
        with suppress(DataError):  # which is said when the bag is loaded
            used += choose_topics(Log(path), listed, bag_options(arguments)).values()
        if not arguments.json:
            print(words.topic_table(listed, used), end="\n\n", flush=True)
    recording = load_dataset(arguments)
    if arguments.json:
        topics = {
            name: {"type": kind, "messages": n, "used": name in used} for name, (kind, n) in listed.items()
        }
        print_json(words.described(recording) | ({"topics": topics} if topics else {}))
    else:
        print(words.describe(recording))


def print_json(content: dict[str, Any]) -> None:
    """Print an answer as JSON; what is not finite becomes null."""
    print(json.dumps(plain(content), indent=2, allow_nan=False))


def check_command(arguments: Namespace) -> int:
    """Print the check-up of a data set as a run would use it; the exit code is 1 if more than a note was made."""
    recording, findings = load_corrected(arguments)
    failed = sum(finding.severity in ("warning", "stop") for finding in findings)
    if arguments.json:
        answer = {"dataset": recording.name, "failed": failed, "notes": list(recording.notes)}
        print_json(answer | {"checks": list(map(asdict, findings))})
        return 1 if failed else 0
    said = [*words.remedies(findings), *words.said_by_the_loader(recording)]
    print(words.check_table(findings), *said, sep="\n")
    print(f"{failed} of {len(findings)} checks failed" if failed else "no check failed")
    return 1 if failed else 0


def convert_command(arguments: Namespace) -> None:
    """Write a data set into one file that loads without ROS."""
    if not arguments.force and os.path.lexists(arguments.out):
        raise DataError(arguments.out, "OUT", "a file that is there already", "another name, or --force")
    recording = load_dataset(arguments)
    save(recording, arguments.out, images=arguments.images, progress=progress_bar("writing"))
    print(*words.said_by_the_loader(recording), f"the recording is in {arguments.out}", sep="\n")


def report_command(arguments: Namespace) -> None:
    """Draw the report's figures as PNG files."""
    need("matplotlib", "plots")
    out, recording, count = out_folder(arguments), load_moving(arguments, load_whole(arguments)), 0
    check_writable(out)
    with results_in(out, "report", arguments.force) as folder:
        for name, figure in report_figures(recording, progress=progress_bar("figures")):
            with atomic_write(folder / f"{name}.png") as file:
                figure.savefig(file, format="png", dpi=150)
            count += 1
    print("the figures show the report's filter; `pfslam run` makes the map of the refined filter")
    print(f"{count} figures are in {out}")


def study_command(arguments: Namespace) -> int:
    """Make the runs of a study that are missing, and its table."""
    from pfslam.study import read_study, run_study  # which other commands can do without
    from pfslam.study.runner import check_table
    from pfslam.study.table import read_table

    study = read_study(arguments.file)
    out = arguments.out or Path("out") / study.name
    if not arguments.force:
        check_table(study, out)
    # Ctrl-C may meet joblib while it frees a semaphore; its tracker then warns of one that is already free. Or it meets
    # tasks under way, and joblib counts them.
    os.environ.setdefault("PYTHONWARNINGS", "ignore:resource_tracker:UserWarning")
    warnings.filterwarnings("ignore", module="joblib.parallel")
    path = run_study(study, out, jobs=arguments.jobs, progress=progress_bar("runs"))
    errors = read_table(path)["error"]
    failed = int(np.count_nonzero(errors != ""))
    complaint = f"{failed} of {len(errors)} runs failed, see the column error; " if failed else ""
    print(f"{complaint}{len(errors)} runs are in {path}")
    return FAULT if failed == len(errors) else 0


def completion_command(arguments: Namespace) -> None:
    """Print the script with which a shell completes this command line."""
    need("shtab", "completion")
    import shtab

    print(shtab.complete(build_parser(), shell=arguments.shell))
