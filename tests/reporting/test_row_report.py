import json
from dataclasses import replace

import numpy as np
import pytest
from PIL import Image
from tests.studies.conftest import rows_of, study, undisturbed  # noqa: F401

from omniservo.reporting.row_report import write_row_report
from omniservo.studies import RowResult, run_row


@pytest.mark.slow
def test_the_last_picture_has_dark_balls_where_the_points_truly_are(study, tmp_path):  # noqa: F811
    number = next(n for n in range(study.rows) if study.place(n)[1:] == ("perspective", "ibvs"))
    result = run_row(study, number)
    write_row_report(tmp_path, study, result)
    picture = np.asarray(Image.open(tmp_path / "final.png")).astype(int).max(axis=2)
    seen, valid = result.scene.camera.project(result.trajectory.end.inv().apply(result.scene.points))
    hidden = result.scene.hidden(result.scene.points, np.array(result.trajectory.end.translation))
    u, v = np.rint(seen[valid & ~hidden]).astype(int).T
    assert len(u) > 10
    assert picture[v, u].max() < 40
    assert np.median(picture) > 150


def test_a_row_that_crashed_has_a_report_with_its_error_escaped(study, undisturbed, tmp_path):  # noqa: F811
    reason = "ValueError: <script>alert(1)</script>"
    row = replace(rows_of(undisturbed)[1], status="error", reason=reason, success=False)
    write_row_report(tmp_path, study, RowResult(row))
    report = (tmp_path / "report.html").read_text()
    assert "<script>" not in report
    assert "ValueError: &lt;script&gt;" in report
    assert json.loads((tmp_path / "row.json").read_text())["reason"] == reason
    assert sorted(path.name for path in tmp_path.iterdir()) == ["report.html", "row.json", "row.png"]


def test_a_row_that_arrived_and_collided_is_headed_by_the_collision(study, undisturbed, tmp_path):  # noqa: F811
    row = replace(
        rows_of(undisturbed)[1], status="converged", reason="", success=False, collision=True,
        final_rotation_error_rad=0.01,
    )  # fmt: skip
    write_row_report(tmp_path, study, RowResult(row))
    report = (tmp_path / "report.html").read_text()
    assert "<strong>Collision. </strong>" in report
    assert "No success" not in report
    assert '<th scope="row">final rotation error</th><td>0.573°</td>' in report
