"""What commands leave: whole or not at all, nothing of anybody else's replaced or deleted, and runs that repeat."""

import json
import os
import shutil
import subprocess
from dataclasses import replace
from zipfile import ZIP_DEFLATED, ZipFile

import numpy as np
import pytest
from box_recording import box_recording
from numpy.lib.format import write_array_header_1_0

import pfslam
from pfslam.cli import commands
from pfslam.cli.main import main
from pfslam.errors import DataError
from pfslam.io.course import save_course
from pfslam.io.recordings import load_recording


@pytest.fixture(scope="module")
def drive(tmp_path_factory):
    """A short drive in a box, in one file."""
    path = tmp_path_factory.mktemp("drive") / "box.npz"
    pfslam.save(box_recording(images=0), path)
    return path


def contents(folder):
    return {str(p.relative_to(folder)): p.read_bytes() for p in folder.rglob("*") if p.is_file()}


def run(drive, out, *more):
    return main(["run", str(drive), "--out", str(out), "--method", "matching", "--quiet", *more])


@pytest.fixture(scope="module")
def done(drive, tmp_path_factory):
    """A folder with a finished run."""
    out = tmp_path_factory.mktemp("done") / "a"
    assert run(drive, out) == 0
    return out


@pytest.fixture
def again(done, tmp_path):
    return shutil.copytree(done, tmp_path / "again")


def test_a_run_into_the_folder_of_the_last_replaces_that(drive, again):
    assert run(drive, again, "--loops") == 0
    assert run(drive, again) == 0
    assert set(contents(again)) == set(json.loads((again / "summary.json").read_bytes())["files"])


FOREIGN = {
    "a map that was drawn by hand": lambda out: (out / "map.pgm").write_bytes(b"mine"),
    "a summary of another program": lambda out: (out / "summary.json").write_text(
        '{"files": ["thesis.png"]}'
    ),
    "a summary that lists a file of somebody's": lambda out: edit(out, files=["summary.json", "thesis.png"]),
    "a summary that somebody wrote into": lambda out: edit(out, note="my best run"),
    "a link": lambda out: (out / "map.pgm").unlink() or (out / "map.pgm").symlink_to(out / "thesis.png"),
    "a folder in the place of a file": lambda out: (out / "map.pgm").unlink() or (out / "map.pgm").mkdir(),
}


def edit(out, **changes):
    content = json.loads((out / "summary.json").read_bytes())
    (out / "summary.json").write_text(json.dumps(content | changes, indent=2) + "\n")


@pytest.mark.parametrize("what", FOREIGN)
def test_nothing_of_anybody_elses_is_replaced_or_deleted(drive, again, capsys, what):
    (again / "thesis.png").write_bytes(b"three years")
    FOREIGN[what](again)
    before = contents(again)
    assert run(drive, again) == 2
    assert "expected another folder, or --force to replace it" in capsys.readouterr().err
    assert contents(again) == before


def test_results_of_another_command_stay(drive, again, capsys):
    before = contents(again)
    line = ["locate", str(again / "map.yaml"), str(drive), "--particles", "500", "--out", str(again)]
    assert main(line) == 2
    assert (
        "trajectory.tum: file: found a file that this command did not write there" in capsys.readouterr().err
    )
    assert main(["report", str(drive), "--out", str(again)]) == 0
    assert {name: contents(again)[name] for name in before} == before
    main([*line, "--force"])
    assert {"map.yaml", "map.pgm", "located.png"} <= set(contents(again))


def test_force_replaces_what_the_run_writes_and_leaves_the_rest(drive, done, again):
    (again / "thesis.png").write_bytes(b"three years")
    (again / "map.pgm").write_bytes(b"mine")
    assert run(drive, again, "--force") == 0
    found, expected = contents(again), contents(done)
    assert found.pop("thesis.png") == b"three years"
    assert {name: found[name] for name in expected if name not in ("summary.json", "index.html")} == {
        name: expected[name] for name in expected if name not in ("summary.json", "index.html")
    }


@pytest.mark.parametrize("fails", ["write_results", "write_pictures", "write_summary"])
def test_a_run_that_fails_while_it_writes_leaves_what_was_there(drive, again, monkeypatch, capsys, fails):
    def full(*_):
        raise OSError(28, "No space left on device")

    before = contents(again)
    monkeypatch.setattr(commands, fails, full)
    assert run(drive, again, "--loops") == 2
    assert "No space left on device" in capsys.readouterr().err
    assert contents(again) == before
    assert not [p for p in again.iterdir() if p.name.startswith(".")]


def test_a_place_in_a_message_is_the_folder_that_was_asked_for(drive, tmp_path, monkeypatch, capsys):
    def full(path, _):
        raise DataError(path, "writing", "No space left on device", "room")

    monkeypatch.setattr(commands, "write_tum", full)
    assert run(drive, tmp_path / "out") == 2
    assert f"{tmp_path / 'out' / 'odometry.tum'}: writing" in capsys.readouterr().err


def test_the_files_that_a_run_may_write_are_known_before_it_begins(drive, tmp_path):
    assert run(drive, tmp_path / "out", "--loops") == 0
    named = commands.files_of_run(pfslam.load(drive), texture=False, loops=True)
    assert set(contents(tmp_path / "out")) <= set(named)


def test_simulated_data_never_replace_a_data_set_but_may_be_written_again(tmp_path, capsys):
    line = ["simulate", "hall", "--out", str(tmp_path)]
    save_course(box_recording(images=0), 20, tmp_path)
    before = contents(tmp_path)
    assert main(line) == 2
    assert "20.npz: file: found a file that this command did not write there" in capsys.readouterr().err
    assert contents(tmp_path) == before
    assert main([*line, "--force"]) == 0
    simulated = contents(tmp_path)
    assert main(line) == 0
    assert contents(tmp_path) == simulated


def test_a_file_that_is_there_is_not_converted_over(drive, tmp_path, capsys):
    path = tmp_path / "drive.npz"
    path.write_bytes(b"another drive")
    assert main(["convert", str(drive), str(path)]) == 2
    assert "drive.npz: OUT: found a file that is there already" in capsys.readouterr().err
    assert path.read_bytes() == b"another drive"
    assert main(["convert", str(drive), str(path), "--force"]) == 0
    assert len(load_recording(path).lidar.t) == 55


def test_the_table_of_a_study_is_replaced_as_long_as_nobody_has_changed_it(drive, tmp_path, capsys):
    file, out = tmp_path / "mine.toml", tmp_path / "out"
    common = f'dataset = "{drive}"\nmethod = "dead-reckoning"'
    file.write_text(f'name = "mine"\n[common]\n{common}\n[[variant]]\nlabel = "a"\n', encoding="utf-8")
    line = ["study", str(file), "--out", str(out), "--jobs", "1"]
    assert main(line) == 0
    assert main(line) == 0
    (out / "mine.csv").write_text("my notes")
    assert main(line) == 2
    assert "mine.csv: file: found a file that this command did not write there" in capsys.readouterr().err
    assert (out / "mine.csv").read_text() == "my notes"
    assert main([*line, "--force"]) == 0


def test_a_run_over_a_part_of_a_drive_is_repeated_from_its_summary(drive, tmp_path, capsys):
    part = [
        "--from",
        "0.5",
        "--until",
        "4",
        "--mask",
        "-135",
        "-120",
        "--mask",
        "100",
        "135",
        "--range",
        "0.2",
        "9",
    ]
    assert run(drive, tmp_path / "a", *part) == 0
    summary = tmp_path / "a" / "summary.json"
    assert run(drive, tmp_path / "b", "--config", str(summary)) == 0
    assert (tmp_path / "a/trajectory.tum").read_bytes() == (tmp_path / "b/trajectory.tum").read_bytes()
    assert run(drive, tmp_path / "c", "--config", str(summary), "--until", "3") == 0
    stored = [json.loads((tmp_path / name / "summary.json").read_bytes())["selection"] for name in "abc"]
    assert stored[0] == stored[1]
    assert stored[2] == ["3" if word == "4" else word for word in stored[0]]
    for bad in (["--frm", "3"], ["--from", "soon"], 5, [7]):
        edit(tmp_path / "a", selection=bad)
        assert run(drive, tmp_path / "d", "--config", str(summary)) == 2
        assert "selection: found" in capsys.readouterr().err


# ---- what programs and shells ask for ----------------------------------------------------------


def test_answers_come_as_json(drive, tmp_path, capsys):
    said = {}
    for command in ("info", "check"):
        main([command, str(drive), "--json"])
        said[command] = json.loads(capsys.readouterr().out)
    assert said["info"]["streams"]["lidar"]["readings"] == 55
    assert said["info"]["lidar"]["beams"] == 1081
    findings = pfslam.evaluation.checkup.check_up(pfslam.load(drive))
    assert [check["question"] for check in said["check"]["checks"]] == [f.question for f in findings]
    assert said["check"]["failed"] == sum(f.severity in ("warning", "stop") for f in findings)
    assert run(drive, tmp_path / "a") == 0
    line = ["locate", str(tmp_path / "a/map.yaml"), str(drive), "--particles", "500"]
    code = main([*line, "--out", str(tmp_path / "b"), "--json"])
    found = json.loads(capsys.readouterr().out)
    assert found["found"] == (code == 0)
    assert found == json.loads((tmp_path / "b/summary.json").read_bytes())


@pytest.mark.parametrize(
    ("line", "meant"),
    [
        ("rnu hall", "did you mean run?"),
        ("run hall --partciles 5", "did you mean --particles?"),
        ("run hall --method refned", "did you mean refined?"),
        ("check hall --form 3", "did you mean --from?"),
        ("simulate hal --out x", "did you mean hall?"),
        ("run hall --zzz", "unrecognized arguments: --zzz (see"),
    ],
)
def test_a_word_that_was_probably_meant_is_named(capsys, line, meant):
    assert main(line.split()) == 2
    assert meant in capsys.readouterr().err


def test_a_shell_completes_commands_and_options(tmp_path, capsys):
    for shell in ("bash", "zsh", "fish"):
        assert main(["completion", shell]) == 0
        script = capsys.readouterr().out
        assert all(word in script for word in ("locate", "second-look", "lidar-at"))
    assert main(["completion", "bash"]) == 0
    (tmp_path / "box.npz").touch()
    script = capsys.readouterr().out + (
        '\nask() { COMP_WORDS=("$@"); COMP_CWORD=$(($# - 1)); COMPREPLY=(); _shtab_pfslam; echo "${COMPREPLY[@]}"; }'
        "\nask pfslam lo; ask pfslam run --part; ask pfslam run --method ref; ask pfslam run bo"
    )
    if os.name == "posix":
        done = subprocess.run(
            ["bash", "-c", script], cwd=tmp_path, capture_output=True, text=True, check=True
        )
        assert done.stdout.split() == ["locate", "--particles", "refined", "box.npz"]


def test_the_version_is_told(capsys):
    for flag in ("-V", "--version"):
        with pytest.raises(SystemExit) as stop:
            main([flag])
        assert stop.value.code == 0
        assert capsys.readouterr().out == f"pfslam {pfslam.__version__}\n"


# ---- memory: what a file states is looked at before it is read -----------------------------------


def with_zeros(path, key, shape):
    """Put an array of so many zeros in the place of one in an archive, which takes a thousandth of their bytes."""
    held = dict(np.load(path))
    np.savez(path, **{name: value for name, value in held.items() if name != key})
    with (
        ZipFile(path, "a", ZIP_DEFLATED) as archive,
        archive.open(f"{key}.npy", "w", force_zip64=True) as member,
    ):
        member.write(b"\x93NUMPY\x01\x00")
        header = {"descr": "<f8", "fortran_order": False, "shape": shape}
        write_array_header_1_0_without_magic(member, header)
        for _ in range(8 * int(np.prod(shape)) >> 20):
            member.write(bytes(1 << 20))


def write_array_header_1_0_without_magic(file, header):
    class Tail:
        def write(self, data):
            file.write(data[8:])

    write_array_header_1_0(Tail(), header)


@pytest.mark.parametrize(
    ("name", "key", "shape"),
    [
        ("Encoders7.npz", "counts", (4, 2**22)),
        ("Imu7.npz", "angular_velocity", (3, 2**22)),
        ("Hokuyo7.npz", "ranges", (64, 2**18)),
        ("Hokuyo7.npz", "angle_min", (2**24,)),
        ("truth7.npz", "pose", (2**22, 4)),
        ("box.npz", "lidar.ranges", (2**24,)),
        ("Encoders7.npz", "time_stamps", (2**26,)),
    ],
)
def test_an_array_that_does_not_fit_its_stamps_is_refused_before_it_takes_memory(
    drive, tmp_path, monkeypatch, name, key, shape
):
    save_course(replace(box_recording(images=0)), 7, tmp_path)
    shutil.copy(drive, tmp_path / "box.npz")
    with_zeros(tmp_path / name, key, shape)
    read = []
    getitem = np.lib.npyio.NpzFile.__getitem__
    monkeypatch.setattr(
        np.lib.npyio.NpzFile, "__getitem__", lambda file, key: read.append(key) or getitem(file, key)
    )
    with pytest.raises(DataError, match=f"{name}: {key}: found (float64 of shape|a row of)"):
        pfslam.load("7" if name != "box.npz" else tmp_path / name, tmp_path)
    assert read or key == "time_stamps"
    assert key not in read
