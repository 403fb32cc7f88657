"""The command line: files in, files out, and every kind of bad input with its message."""

import json
import subprocess
import sys

import meshes
import numpy as np
import pytest

from LAFlatteningLib import read_surface, write_seeds, write_surface
from LAFlatteningLib.cli import main
from LAFlatteningLib.surface import Surface


@pytest.fixture
def files(tmp_path, phantom):
    write_surface(phantom.surface, tmp_path / "atrium.vtp")
    write_seeds(phantom.seeds, tmp_path / "seeds.csv")
    return tmp_path


def flatten(files, *more, surface="atrium.vtp", seeds="seeds.csv", output="map.vtp"):
    return main(
        [
            "flatten",
            str(files / surface),
            "--seeds",
            str(files / seeds),
            "--output",
            str(files / output),
            *map(str, more),
        ]
    )


def test_flatten_writes_map_metrics_and_figure(files, phantom, capsys):
    code = flatten(files, "--metrics", files / "m.json", "--figure", files / "f.png")
    assert code == 0
    flat = read_surface(files / "map.vtp")
    assert len(flat.points) == len(phantom.surface.points)
    assert np.array_equal(flat.point_data["LGE"], phantom.surface.point_data["LGE"])
    metrics = json.loads((files / "m.json").read_text())
    assert metrics["folded_triangles"] == metrics["overlapping_pairs"] == 0
    assert metrics["method"] == "regional"
    assert (files / "f.png").read_bytes().startswith(b"\x89PNG")
    out, err = capsys.readouterr()
    assert "folded triangles 0, overlapping pairs 0" in out
    assert "map.vtp" in out
    assert "Error" not in err


def test_map_is_the_same_from_every_surface_format(files, phantom):
    assert flatten(files) == 0
    expected = read_surface(files / "map.vtp").points
    for suffix in (".vtk", ".ply", ".obj", ".VTP"):
        write_surface(phantom.surface, files / f"other{suffix}")
        assert flatten(files, surface=f"other{suffix}", output="other_map.vtp") == 0
        assert np.abs(read_surface(files / "other_map.vtp").points - expected).max() < 1e-3


def test_ras_markups_on_an_lps_surface_are_converted(files, phantom):
    write_seeds({label: at * [-1, -1, 1] for label, at in phantom.seeds.items()}, files / "ras.mrk.json", "RAS")
    assert flatten(files) == 0
    assert flatten(files, seeds="ras.mrk.json", output="ras.vtp") == 0
    assert np.array_equal(read_surface(files / "map.vtp").points, read_surface(files / "ras.vtp").points)


@pytest.mark.parametrize("rounding", ["paper", "half-even", "half-away"])
def test_paper_method_and_roundings(files, rounding):
    assert flatten(files, "--method", "paper", "--rounding", rounding, "--metrics", files / "m.json") == 0
    metrics = json.loads((files / "m.json").read_text())
    assert (metrics["method"], metrics["rounding"]) == ("paper", rounding)


def test_template_by_name_and_by_file(files):
    from LAFlatteningLib.template import _FOLDER

    data = json.loads((_FOLDER / "population.json").read_text())
    data["name"] = "mine"
    (files / "mine.json").write_text(json.dumps(data))
    assert flatten(files, "--template", "population") == 0
    assert flatten(files, "--template", files / "mine.json", output="mine.vtp") == 0
    assert np.array_equal(read_surface(files / "map.vtp").points, read_surface(files / "mine.vtp").points)
    assert read_surface(files / "mine.vtp").field_data["template"].tolist() == ["mine"]


def test_demo_makes_everything_it_says(tmp_path, capsys):
    assert main(["demo", "--output", str(tmp_path / "new" / "demo"), "--points", "2000"]) == 0
    names = {path.name for path in (tmp_path / "new" / "demo").iterdir()}
    assert names == {"atrium.vtp", "seeds.mrk.json", "map.vtp", "metrics.json", "figure.png"}
    assert "folded triangles 0" in capsys.readouterr().out
    # The example in --help: the demo's own files go through `flatten`.
    assert flatten(tmp_path / "new" / "demo", seeds="seeds.mrk.json", output="again.vtp") == 0


def test_info_tells_openings_topology_and_arrays(files, phantom, capsys):
    assert main(["info", str(files / "atrium.vtp")]) == 0
    out = capsys.readouterr().out
    assert "2000 points" in out
    assert "units: probably mm" in out
    assert "patient axes: LPS" in out
    assert "handles (genus): 0" in out
    assert out.count("opening ") == 6
    longest = max(phantom.surface.loop_length(loop) for loop in phantom.surface.boundary_loops)
    assert f"opening 1: perimeter {longest:.4g} mm" in out
    assert "point array LGE: 100 to 170" in out


def test_info_guesses_metres_and_bears_bad_meshes(files, phantom, capsys):
    small = Surface(phantom.surface.points / 1000, phantom.surface.triangles)
    write_surface(small, files / "metres.vtp")
    assert main(["info", str(files / "metres.vtp")]) == 0
    out = capsys.readouterr().out
    assert "probably metres; multiply by 1000" in out
    assert "mm," not in out.split("opening 1")[1].splitlines()[0]
    write_surface(meshes.tetrahedra_sharing_a_point(), files / "bad.vtp")
    assert main(["info", str(files / "bad.vtp")]) == 0
    assert "not a clean sheet at 1 points" in capsys.readouterr().out
    # A loose triangle: what is left once it is mended is told.
    extra = np.concatenate([phantom.surface.points, [[0.0, 0, 0], [1, 0, 0], [0, 1, 0]]])
    a, b = phantom.surface.triangles[50, :2]
    fin = np.array([[a, b, len(extra) - 1], [len(extra) - 3, len(extra) - 2, len(extra) - 1]])
    write_surface(Surface(extra, np.concatenate([phantom.surface.triangles, fin])), files / "fin.vtp")
    assert main(["info", str(files / "fin.vtp")]) == 0
    out = capsys.readouterr().out
    assert "not a clean sheet" in out and "as la-flatten prepare mends it" in out
    longest = max(phantom.surface.loop_length(loop) for loop in phantom.surface.boundary_loops)
    assert f"opening 1: perimeter {longest:.4g} mm" in out


def test_help_has_a_worked_example(capsys):
    for command in ([], ["flatten"], ["demo"], ["info"]):
        with pytest.raises(SystemExit) as stopped:
            main([*command, "--help"])
        assert stopped.value.code == 0
        assert "la-flatten" in capsys.readouterr().out.split("Example")[1]


def test_python_dash_m_is_the_command(files):
    done = subprocess.run([sys.executable, "-m", "LAFlatteningLib", "--version"], capture_output=True, text=True)
    assert done.returncode == 0
    assert done.stdout.startswith("la-flatten ")


# ---- bad input: exit code 2, one message, nothing written ----


def spoil_surface(change):
    def spoil(files, phantom):
        write_surface(change(phantom.surface), files / "atrium.vtp")

    return spoil


def spoil_seeds(change):
    def spoil(files, phantom):
        write_seeds(change(dict(phantom.seeds)), files / "seeds.csv")

    return spoil


def write(name, text):
    return lambda files, phantom: (files / name).write_text(text)


def with_triangles(surface, extra):
    return Surface(surface.points, np.concatenate([surface.triangles, extra]))


def nan_point(files, phantom):
    polydata = phantom.surface.to_polydata()
    import vtk

    copy = vtk.vtkPolyData()
    copy.DeepCopy(polydata)
    copy.GetPoints().SetPoint(7, float("nan"), 0.0, 0.0)
    writer = vtk.vtkXMLPolyDataWriter()
    writer.SetFileName(str(files / "atrium.vtp"))
    writer.SetInputData(copy)
    writer.Write()


def only_points(files, phantom):
    import vtk

    cloud = vtk.vtkPolyData()
    cloud.SetPoints(phantom.surface.to_polydata().GetPoints())
    writer = vtk.vtkXMLPolyDataWriter()
    writer.SetFileName(str(files / "atrium.vtp"))
    writer.SetInputData(cloud)
    writer.Write()


def mirror(files, phantom):
    flip = np.array([-1.0, 1.0, 1.0])
    write_surface(Surface(phantom.surface.points * flip, phantom.surface.triangles), files / "atrium.vtp")
    write_seeds({label: at * flip for label, at in phantom.seeds.items()}, files / "seeds.csv")


def duplicate_line(files, phantom):
    lines = (files / "seeds.csv").read_text().splitlines()
    (files / "seeds.csv").write_text("\n".join([*lines, lines[1]]) + "\n")


BAD = {
    "missing file": (lambda files, phantom: (files / "atrium.vtp").unlink(), "atrium.vtp"),
    "not a mesh": (write("atrium.vtp", "hello"), "not a VTK XML file"),
    "no triangles": (only_points, "no triangles"),
    "non-manifold": (
        spoil_surface(lambda s: with_triangles(s, [[*s.triangles[100][:2], 5]])),
        "not a clean sheet",
    ),
    "two components": (
        spoil_surface(
            lambda s: Surface(
                np.concatenate([s.points, meshes.icosphere(5, 1).points]),
                np.concatenate([s.triangles, meshes.icosphere(5, 1).triangles + len(s.points)]),
            )
        ),
        "2 separate pieces",
    ),
    "NaN points": (nan_point, "not a number"),
    "wrong number of openings": (
        spoil_surface(lambda s: meshes.cylinder(20, 60)),
        "Expected 6 openings",
    ),
    "genus": (spoil_surface(lambda s: meshes.torus()), "handle"),
    "metres": (spoil_surface(lambda s: Surface(s.points / 1000, s.triangles)), "look like metres"),
    "seed missing": (spoil_seeds(lambda s: {k: v for k, v in s.items() if k != "LAA"}), "Seed missing: LAA"),
    "seed duplicated": (duplicate_line, "RSPV"),
    "seed on the wrong opening": (spoil_seeds(lambda s: {**s, "RIPV": s["RSPV"]}), "sit on the same opening"),
    "seed off the surface": (spoil_seeds(lambda s: {**s, "MV1": s["MV1"] + 30.0}), "MV1 is"),
    "swapped seeds": (spoil_seeds(lambda s: {**s, "LAA": s["LSPV"], "LSPV": s["LAA"]}), "LAA"),
    "mirrored anatomy": (mirror, "anatomy is mirrored"),
    "RAS seeds on an LPS surface": (
        spoil_seeds(lambda s: {k: v * [-1, -1, 1] for k, v in s.items()}),
        "seeds are in RAS and the surface is in LPS",
    ),
    "no seeds file": (lambda files, phantom: (files / "seeds.csv").unlink(), "seeds.csv"),
    "seeds that are no table": (write("seeds.csv", "\x00\x01"), "seeds.csv"),
}


@pytest.mark.parametrize("kind", BAD)
def test_bad_input(files, phantom, capsys, kind):
    spoil, message = BAD[kind]
    spoil(files, phantom)
    before = sorted(path.name for path in files.iterdir())
    assert flatten(files, "--metrics", files / "m.json", "--figure", files / "f.png", "--quiet") == 2
    out, err = capsys.readouterr()
    assert out == ""
    assert err.startswith("la-flatten: ")
    assert err.count("la-flatten: ") == 1
    assert message in err
    assert "Traceback" not in err
    assert sorted(path.name for path in files.iterdir()) == before


@pytest.mark.parametrize("option", ["--output", "--metrics", "--figure"])
def test_unwritable_output_is_refused_before_any_work(files, capsys, option):
    (files / "a_file").write_text("")
    place = str(files / "a_file" / "x.png")
    arguments = ["flatten", str(files / "atrium.vtp"), "--seeds", str(files / "seeds.csv")]
    arguments += ["--output", str(files / "map.vtp")] if option != "--output" else []
    assert main([*arguments, option, place]) == 2
    assert "a_file" in capsys.readouterr().err
    assert not (files / "map.vtp").exists()


def test_existing_output_survives_bad_input(files, capsys):
    (files / "map.vtp").write_text("precious")
    (files / "seeds.csv").write_text("label,x_mm,y_mm,z_mm\n")
    assert flatten(files) == 2
    assert (files / "map.vtp").read_text() == "precious"


def test_unknown_array_for_the_figure_names_the_known(files, capsys):
    assert flatten(files, "--figure", files / "f.png", "--array", "voltage") == 2
    assert "LGE" in capsys.readouterr().err
    assert not (files / "map.vtp").exists()


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["--array", "LGE"], "give --figure"),
        (["--rounding", "half-even"], "belongs to --method paper"),
        (["--figure", "f.gif"], "gif"),
        (["--output", "map.stl"], "lose the arrays"),
        (["--output", "atrium.vtp"], "given twice"),
        (["--metrics", "seeds.csv"], "given twice"),
        (["--metrics", "map.vtp"], "given twice"),
    ],
)
def test_contradictory_options_are_refused_and_nothing_is_overwritten(files, capsys, monkeypatch, arguments, message):
    monkeypatch.chdir(files)
    before = {path.name: path.read_bytes() for path in files.iterdir()}
    base = ["flatten", "atrium.vtp", "--seeds", "seeds.csv"]
    assert main([*base, *([] if "--output" in arguments else ["--output", "map.vtp"]), *arguments]) == 2
    assert message in capsys.readouterr().err
    assert {path.name: path.read_bytes() for path in files.iterdir()} == before


def test_a_failure_at_the_last_file_writes_none(files, monkeypatch):
    from LAFlatteningLib.cli import command

    def fail(*_):
        raise KeyboardInterrupt

    monkeypatch.setattr(command, "write_surface", fail)
    before = sorted(path.name for path in files.iterdir())
    assert flatten(files, "--metrics", files / "m.json", "--figure", files / "f.png") == 130
    assert sorted(path.name for path in files.iterdir()) == before


def test_surface_in_coordinates_of_its_own(files, phantom, capsys):
    turn = np.array([-1.0, -1.0, 1.0])
    write_surface(Surface(phantom.surface.points * turn, phantom.surface.triangles), files / "turned.vtp")
    write_seeds({label: at * turn for label, at in phantom.seeds.items()}, files / "turned.csv")
    assert flatten(files, surface="turned.vtp", seeds="turned.csv") == 2
    assert "--ignore-axes" in capsys.readouterr().err
    assert flatten(files, "--ignore-axes", surface="turned.vtp", seeds="turned.csv") == 0


def test_progress_is_shown_after_a_second_and_not_before(capsys, monkeypatch):
    from LAFlatteningLib.cli.progress import Progress

    progress = Progress(quiet=False)
    progress(0.1, "Reading")
    assert capsys.readouterr().err == ""
    progress._timer.join(timeout=5)
    assert "Reading" in capsys.readouterr().err
    progress(0.5, "Flattening")
    assert "50 %  Flattening" in capsys.readouterr().err
    progress.clear()
    quiet = Progress(quiet=True)
    quiet(0.5, "Flattening")
    quiet.clear()
    assert capsys.readouterr().err == ""


def test_map_is_tagged_so_that_slicer_shows_it_upright(files):
    assert flatten(files) == 0
    assert read_surface(files / "map.vtp").space == "RAS"
