"""The notebooks run from their first cell to their last, show what they say, and are stored without outputs.

Stored outputs would be megabytes that no one can review, and old after the next change.
"""

import os
import sys
from pathlib import Path

import nbformat
import pytest
from nbclient import NotebookClient

FOLDER = Path(__file__).resolve().parents[2] / "examples/notebooks"
NOTEBOOKS = sorted(FOLDER.glob("*.ipynb"))


@pytest.fixture(scope="module")
def executed():
    done = {}

    def run(name):
        if name not in done:
            notebook = nbformat.read(FOLDER / f"{name}.ipynb", as_version=4)
            client = NotebookClient(notebook, timeout=600, kernel_name="python3")
            os.environ["PYTHONPATH"] = os.pathsep.join(filter(None, sys.path))  # the kernel's
            done[name] = client.execute()
        return done[name]

    return run


def shown(notebook, kind):
    """The outputs of this kind, by the last line of their cells."""
    return {
        cell.source.splitlines()[-1]: output.data[kind]
        for cell in notebook.cells
        if cell.cell_type == "code"
        for output in cell.outputs
        if output.output_type == "execute_result" and kind in output.data
    }


def printed(notebook):
    return "".join(
        output.text
        for cell in notebook.cells
        if cell.cell_type == "code"
        for output in cell.outputs
        if output.output_type == "stream" and output.name == "stdout"
    )


def warned(notebook):
    return [o.text for c in notebook.cells for o in c.get("outputs", ()) if o.get("name") == "stderr"]


def test_there_are_two():
    assert [path.stem for path in NOTEBOOKS] == ["first_plan", "my_camera"]


@pytest.mark.parametrize("path", NOTEBOOKS, ids=lambda path: path.stem)
def test_a_notebook_is_stored_without_outputs(path):
    notebook = nbformat.read(path, as_version=4)
    nbformat.validate(notebook)
    for cell in notebook.cells:
        assert cell.cell_type == "markdown" or (not cell.outputs and cell.execution_count is None)


@pytest.mark.slow
def test_the_first_plan_is_certified_verified_drawn_and_refused_where_too_much_is_wanted(executed):
    notebook = executed("first_plan")
    html, images = shown(notebook, "text/html"), shown(notebook, "image/png")
    assert "certified" in html["plan"]
    assert "data:image/webp" in html["plan"]
    assert "92.5°" in html["camera"]
    assert {"plan.plot()", "answer.plot()"} <= set(images)
    lines = printed(notebook).splitlines()
    assert [line.split(": ")[1].split()[0] for line in lines[-4:]] == [*3 * ["certified"], "infeasible"]
    assert warned(notebook) == []


@pytest.mark.slow
def test_my_camera_comes_out_near_the_one_that_took_the_images(executed):
    notebook = executed("my_camera")
    html, images = shown(notebook, "text/html"), shown(notebook, "image/png")
    assert "views used" in html["found.calibration"]
    assert "translation" in html["estimate"]
    assert {"camera.plot_field()", "estimate.plot()"} <= set(images)
    rays, motion = (line for line in printed(notebook).splitlines() if "off" in line)
    assert float(rays.split("off by ")[1].split("°")[0]) < 0.1
    assert float(motion.split("by ")[1].split(" mm")[0]) < 1.0
    assert warned(notebook) == []
