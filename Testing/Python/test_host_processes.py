"""What only a process of its own shows: a scene opened in a new one, and the module's own test as a whole."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
HOST = ROOT / "Testing" / "Host"
MODULE = ROOT / "LAFlattening" / "LAFlattening.py"

START = """
import json, sys, time
import slicer_host

slicer = slicer_host.start(views=True)
from slicer_host import loading

panel = loading.enter(loading.load_module(sys.argv[1]))


def settle(seconds=0.5):
    end = time.monotonic() + seconds
    while time.monotonic() < end:
        slicer.app.processEvents()


def state():
    logic, p = panel.logic, panel.parameterNode
    mapNode, ui = p.map, panel.ui
    table = ui.metricsTable
    return {
        "names": [p.surface.GetName(), p.seeds.GetName(), mapNode.GetName()],
        "selected": [box.currentNode().GetName() for box in (ui.surfaceSelector, ui.seedsSelector, ui.mapSelector)],
        "links": [
            mapNode.GetNodeReference("LAFlattening.surface").GetName(),
            mapNode.GetNodeReference("LAFlattening.seeds").GetName(),
            p.surface.GetNodeReference("LAFlattening.map").GetName(),
            p.metrics.GetName(),
        ],
        "points": slicer.util.arrayFromModelPoints(mapNode).round(4).tolist(),
        "lge": slicer.util.arrayFromModelPointData(mapNode, "LGE").round(4).tolist(),
        "region": slicer.util.arrayFromModelCellData(mapNode, "region").tolist(),
        "diameter": [p.diskDiameter, ui.diskDiameterSlider.value],
        "checks": [box.checked for box in (ui.showLabels, ui.liveUpdate, ui.showColourBar, ui.snapSeeds)],
        "colours": ui.colourSelector.currentText,
        "metrics": [[table.item(r, c).text() for c in range(3)] for r in range(table.rowCount)],
        "stage": mapNode.GetAttribute("LAFlattening.stage"),
        "outdated": ui.mapMessage.text,
    }
"""

SAVE = """
p = panel.parameterNode
p.liveUpdate = False
p.surface, p.seeds = panel.logic.loadSample(points=1000)
p.diskDiameter = 80.0
panel.ui.showLabels.click()
panel.ui.flattenButton.click()
settle()
state_now = state()
assert slicer.util.saveScene(sys.argv[2])
print("STATE" + json.dumps(state_now))
"""

LOAD = """
slicer.util.loadScene(sys.argv[2])
settle()
panel.enter()
settle()
loaded = state()
# The links work, and the map is known to be that of these seeds: switching following on changes nothing.
panel.ui.liveUpdate.click()
settle()
after = state()
assert after["points"] == loaded["points"], "the map was made anew"
surface, flat = panel.parameterNode.surface, panel.parameterNode.map
panel.logic.colourBy(surface, "region")
assert panel.logic.colouredBy(flat)[0] == "region"
seeds = panel.parameterNode.seeds
index = seeds.GetControlPointIndexByLabel("RSPV")
x, y, z = seeds.GetNthControlPointPositionWorld(index)
seeds.SetNthControlPointPositionWorld(index, x, y + 3.0, z)
end = time.monotonic() + 20.0
while slicer.util.arrayFromModelPoints(flat).round(4).tolist() == loaded["points"]:
    assert time.monotonic() < end, "the map does not follow"
    slicer.app.processEvents()
print("STATE" + json.dumps(loaded))
"""

LOOK = """
import sys
import slicer_host

slicer = slicer_host.start(views=True)
from slicer_host import loading

loading.load_module(sys.argv[1])
slicer.util.loadScene(sys.argv[2], {"clear": bool(sys.argv[3])})
slicer.app.processEvents()
print(slicer.app.layoutManager().layoutLogic().GetViewNodes().GetNumberOfItems(), "views")
"""

TEST = """
import sys
import slicer_host

slicer = slicer_host.start(views=True)
from slicer_host import loading

loading.load_module(sys.argv[1])
from LAFlattening import LAFlatteningTest

LAFlatteningTest().runTest()
print("all passed")
"""


def run(script: str, *arguments: str, seconds: int = 300) -> str:
    """What a script prints, run in a new process."""
    done = subprocess.run(
        [sys.executable, "-c", script, *arguments],
        capture_output=True,
        text=True,
        env={**os.environ, "PYTHONPATH": str(HOST)},
        timeout=seconds,
        check=False,
    )
    assert done.returncode == 0, done.stdout + done.stderr
    assert "Traceback" not in done.stderr, done.stderr
    return done.stdout


def state_in(output: str) -> dict:
    import json

    return json.loads(next(line for line in output.splitlines() if line.startswith("STATE")).removeprefix("STATE"))


def test_a_scene_opens_in_a_new_process_as_it_was_saved(host_with_views, host_with_qt, tmp_path):
    file = str(tmp_path / "scene.mrb")
    saved = state_in(run(START + SAVE, str(MODULE), file))
    loaded = state_in(run(START + LOAD, str(MODULE), file))
    assert saved["diameter"] == [80.0, 80.0] and saved["checks"][0] is False and saved["colours"] == "LGE (a.u.)"
    assert loaded == saved


def test_a_scene_that_is_opened_before_the_panel_has_its_views(host_with_views, host_with_qt, tmp_path):
    file = str(tmp_path / "scene.mrb")
    run(START + SAVE, str(MODULE), file)
    for clear in ("", "clear"):
        assert "2 views" in run(LOOK, str(MODULE), file, clear)


def test_the_test_of_an_installed_module_passes_whole(host_with_views, host_with_qt, tmp_path):
    """Without the source tree, whose tests run by themselves: the module with the library beside it."""
    for part in ("LAFlattening", "LAFlatteningLib"):
        shutil.copytree(ROOT / part, tmp_path / part, ignore=shutil.ignore_patterns("__pycache__"))
    assert "all passed" in run(TEST, str(tmp_path / "LAFlattening" / "LAFlattening.py"))
