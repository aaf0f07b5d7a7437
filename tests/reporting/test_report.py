"""The report: one file, complete, and safe against what files say."""

import re
from dataclasses import replace
from html import unescape
from html.parser import HTMLParser

import numpy as np
import pytest

from omniservo.errors import InputError
from omniservo.reporting import write_report
from omniservo.reporting.margins import certified_clearance, clearance
from omniservo.reporting.metric_meanings import meaning_of, spell_metric
from omniservo.reporting.promise_words import CERTIFIED, EXECUTED, REQUIRED
from omniservo.reporting.report_sections import (
    key_numbers,
    metrics,
    paper_and_ours,
    reproduce,
    side_by_side,
    timings,
    verdict,
)
from omniservo.reporting.run_summary import run_summary
from omniservo.reporting.spelling import reads_less, significant, spell, spell_bound
from omniservo.reporting.verdict import planner_sentence, verdict_of
from omniservo.reporting.views import outside
from omniservo.reporting.write_figures import drawings
from omniservo.results.run_log import RunLog
from omniservo.risk import RiskPlan, UncertainMargin
from omniservo.risk.risk_plan import RiskReasons

VOID = {"meta", "img"}
BESIDE = ("image.png", "image.svg", "arm-gap.png", "arm-gap.svg", "metrics.json", "log.csv", "notes.txt")
"""What lies in the folder into which the report is written."""


class Structure(HTMLParser):
    """Collects attributes, text and unbalanced tags."""

    def __init__(self):
        super().__init__()
        self.open, self.wrong, self.tags, self.links, self.words = [], [], [], [], []

    def handle_starttag(self, tag, attrs):
        self.tags.append(tag)
        self.links += [value for key, value in attrs if key in ("src", "href", "srcset", "data", "action")]
        if tag not in VOID:
            self.open.append(tag)

    def handle_endtag(self, tag):
        if not self.open or self.open.pop() != tag:
            self.wrong.append(tag)

    def handle_data(self, data):
        self.words.append(data.strip())


def read(folder):
    structure = Structure()
    page = (folder / "report.html").read_text(encoding="utf-8")
    structure.feed(page)
    return page, structure


@pytest.fixture(scope="module")
def report(run, tmp_path_factory):
    folder = tmp_path_factory.mktemp("report")
    for name in BESIDE:
        (folder / name).write_text("{}")
    write_report(folder, [run])
    return read(folder)


@pytest.fixture
def one_figure(monkeypatch):
    """For claims of a page's words: all figures of it take a second and more."""
    monkeypatch.setitem(drawings.__globals__, "_FIGURES", (clearance,))


@pytest.mark.slow
def test_report_tells_joints_and_time_and_what_other_branches_would_do(report, run):
    structure = report[1]
    said = " ".join(structure.words)
    motion = run.motion
    assert "Joint path" in structure.words
    assert "its own" in structure.words
    assert "the motion takes 4.00 s; the fastest within half" in said
    for name in motion.arm.joint_names:
        assert structure.words.count(name) == 1
    margins, places = motion.least_margins
    fine = motion.joints(np.linspace(0.0, 1.0, 5001))
    low, high = motion.arm.joint_range.T
    np.testing.assert_allclose(margins, np.minimum(fine - low, high - fine).min(axis=0), atol=1e-5)
    for margin, place in zip(margins, places, strict=True):
        assert spell(margin, "rad") in structure.words
        assert f"{place:.3f}" in structure.words
    for branch in motion.others.branches:
        for failure in branch.failures[:1]:
            assert str(failure) in said
    assert structure.words.count("can follow") == sum(b.feasible for b in motion.others.branches)


def tiles_of(result):
    """Label → {word: number} of the tiles on the first screen."""
    tiles = re.findall(r'<p class="label">(.*?)</p><dl>(.*?)</dl>', key_numbers(result).html)
    lines = r"<dt>(.*?)</dt><dd>(.*?)</dd>"
    return {unescape(label): dict(re.findall(lines, rows)) for label, rows in tiles}


def test_every_number_of_a_distance_stands_beside_the_word_that_says_whose_it_is(run):
    tiles = tiles_of(run)
    assert tiles["Camera's centre to the obstacles"] == {
        EXECUTED: "60.70 mm",
        CERTIFIED: spell_bound(certified_clearance(run), "m"),
        REQUIRED: "55.00 mm",
    }
    assert set(tiles["Points to the image's limits"]) == {EXECUTED, CERTIFIED, REQUIRED}
    assert tiles["Any link to any obstacle's body"] == {EXECUTED: "13.70 mm"}


def test_where_less_was_executed_than_certified_the_tile_says_why(run):
    def said(executed):
        metrics = {**run.metrics, "clearance_executed_m": executed, "path_deviation_m": 0.00021}
        return key_numbers(replace(run, metrics=metrics)).html.replace("\u00a0", " ")

    less = said(certified_clearance(run) - 2e-5)
    assert "Less than certified: the proof is of the path, from which the arm deviated by up to 0.210" in less
    assert "The path keeps 10.00 mm more than required" in less
    more = said(certified_clearance(run) + 2e-5)  # the other one is that of the points in the image
    assert less.count("Less than certified") == more.count("Less than certified") + 1


def test_the_report_lists_the_files_beside_it(report):
    for listed in ("image.png, image.svg", "arm-gap.png, arm-gap.svg", *BESIDE[4:]):
        assert listed in report[1].words


@pytest.mark.parametrize("task", ["paper-example-1", "whole-arm-1", "ur5e-table"])
@pytest.mark.parametrize("method", ["certified", "ibvs"])
def test_no_tile_compares_executed_with_planned_without_both_words(made_up_run, task, method):
    for label, rows in tiles_of(made_up_run(task, method=method, steps=3)).items():
        assert set(rows) in ({EXECUTED}, {EXECUTED, CERTIFIED, REQUIRED}), label
        assert "≥" not in rows[EXECUTED]
        assert rows.get(CERTIFIED, "–")[0] in "≥–"
    assert label == "Points to the image's limits"


def test_the_smallest_distance_of_any_link_stands_in_the_first_sentence(run):
    found = verdict_of(run).sentence
    assert "the smallest distance of any link to any obstacle was 13.70 mm" in found
    unknown = replace(run, metrics={**run.metrics, "arm_clearance_executed_m": None})
    assert verdict_of(unknown).sentence.endswith("nothing was touched.")


def test_the_page_says_why_a_path_keeps_away_from_points_in_free_air(run, made_up_run):
    said = verdict(run, named=False).html
    assert "from 2 points in free air because the paper states its obstacle as these points" in said
    assert "passed at 13.70 mm, was not given to the planner" in said
    own = replace(run, task=run.task.model_copy(update={"name": "my-own"}))
    assert "because the task states its obstacle as these points" in planner_sentence(own)
    assert planner_sentence(made_up_run("whole-arm-1", steps=3)) == ""
    assert planner_sentence(made_up_run(method="ibvs", steps=3)) == ""


def test_links_have_a_tile_of_their_own_where_they_are_to_keep_a_distance(made_up_run):
    whole_run = made_up_run("whole-arm-1", steps=3)
    whole_run = replace(whole_run, metrics={**whole_run.metrics, "link_clearance_executed_m": 0.0123})
    for status, certified in (("clear", "≥ 8.00 mm"), ("undecided", "–")):
        whole = replace(whole_run.whole_arm, proof=replace(whole_run.whole_arm.proof, status=status))
        tiles = tiles_of(replace(whole_run, whole_arm=whole))
        assert "Camera's centre to the obstacles" not in tiles
        assert tiles["Any link to what the planner knows"] == {
            EXECUTED: "12.30 mm",
            CERTIFIED: certified,
            REQUIRED: "5.00 mm",
        }


def test_a_run_that_was_stopped_before_its_first_step_says_nothing_of_what_it_did_not_sample(made_up_run):
    whole_run = made_up_run("whole-arm-1", steps=3)
    for planned, said in (
        (None, "had to keep."),
        (0.0123, "keep; sampled, the planned path keeps 12.30\N{NO-BREAK SPACE}mm."),
    ):
        metrics = {**whole_run.metrics, "link_clearance_planned_m": planned}
        assert said in key_numbers(replace(whole_run, metrics=metrics)).html


def test_the_same_three_words_are_used_in_tables_metrics_and_legends(run, report):
    said = " ".join(report[1].words)
    legends = {
        str(text.get_text())
        for drawing in drawings(run)
        for legend in drawing.figure.legends
        for text in legend.get_texts()
    }
    for word in (CERTIFIED, EXECUTED):
        assert any(word in legend for legend in legends), word
        assert meaning_of("clearance_planned_m").label.endswith(CERTIFIED)
        assert meaning_of("clearance_executed_m").label.endswith(EXECUTED)
        assert f"… {word}" in said
    assert any(legend.startswith(REQUIRED) for legend in legends)


def test_the_page_has_a_dark_form_that_can_be_read(report):
    """Of each pair of ink and ground the contrast is that which WCAG asks of text, 4.5 : 1, in both forms."""
    page = report[0]
    style = page[page.index("<style>") : page.index("</style>")]
    dark = style[style.index("prefers-color-scheme: dark") :]
    assert 'name="color-scheme" content="light dark"' in page
    for form in (style, dark):
        colours = dict(re.findall(r"--([\w-]+): (#[0-9a-f]{6});", form[: form.index("}")]))
        for ink, ground in (
            ("ink", "ground"), ("quiet", "ground"), ("accent", "ground"), ("ink", "shade"),
            ("good", "good-ground"), ("bad", "bad-ground"), ("ink", "good-ground"), ("quiet", "good-ground"),
            ("quiet", "bad-ground"),
        ):  # fmt: skip
            assert contrast(colours[ink], colours[ground]) > 4.5, (ink, ground)


def contrast(one, other):
    """WCAG 2's contrast of two colours "#rrggbb"."""

    def luminance(colour):
        channels = np.array([int(colour[i : i + 2], 16) for i in (1, 3, 5)]) / 255.0
        linear = np.where(channels <= 0.04045, channels / 12.92, ((channels + 0.055) / 1.055) ** 2.4)
        return linear @ [0.2126, 0.7152, 0.0722]

    low, high = sorted((luminance(one), luminance(other)))
    return (high + 0.05) / (low + 0.05)


def test_every_figure_is_held_once_and_enlarged_by_a_button_without_a_script(report, run):
    page = report[0]
    opened = re.findall(r'popovertarget="(figure-\w+)"', page)
    shown = re.findall(r'<img id="(figure-\w+)" popover', page)
    assert opened == shown
    assert len(set(opened)) == len(opened) == len(list(drawings(run)))
    assert all("enlarge" in label for label in re.findall(r'aria-label="(.*?)"', page))
    sources = re.findall(r'src="(.*?)"', page)
    assert len(set(sources)) == len(sources) == len(opened) + 1


def test_tables_that_scroll_can_be_reached_by_keyboard_and_show_it(report):
    page = report[0]
    assert page.count('class="scroll" tabindex="0"') == page.count("<table")
    assert "background-attachment: local, local, scroll, scroll" in page


def test_the_time_of_loading_code_is_told_from_that_of_the_job(run):
    loading = replace(run, seconds={**run.seconds, "estimation_code": 0.5, "planning_code": 1.5})
    for told in (key_numbers, paper_and_ours):
        assert "2.00 s of both was loading or compiling code" in told(loading).html.replace("\u00a0", " ")
        assert "loading" not in told(run).html
    assert timings(loading).html.count("of it loading or compiling code") == 2


def test_the_command_that_repeats_a_run_names_no_file_that_there_may_not_be(run):
    assert "omniservo run paper-example-1 --method certified" in reproduce([run]).html
    own = replace(run, task=run.task.model_copy(update={"name": "my-own"}))
    assert "omniservo run TASK.yaml --method certified" in reproduce([own]).html
    assert "TASK.yaml: the file of my-own." in reproduce([own]).html


def test_pictures_from_outside_name_only_what_is_in_them(run):
    assert "obstacles (brick red) and the target's boards, at the start" in outside(run).caption
    empty = run.task.model_copy(update={"obstacles": ()})
    assert "brick red" not in outside(replace(run, task=empty)).caption


def test_report_is_balanced_html_with_a_title(report):
    page, structure = report
    assert page.startswith("<!doctype html>")
    assert not structure.open
    assert not structure.wrong
    assert "title" in structure.tags


def test_report_needs_nothing_but_itself(report):
    page, structure = report
    assert structure.links
    assert all(link.startswith("data:image/") for link in structure.links)
    assert not set(structure.tags) & {"script", "link", "iframe", "object"}
    assert not re.search(r"url\(|@import|https?://", page)


def test_report_contains_every_metric_with_its_value(report, run):
    _, structure = report
    words = structure.words
    for name, value in run.metrics.items():
        assert name in words
        assert meaning_of(name).label in words
        bound = meaning_of(name).label.endswith(CERTIFIED)
        assert (spell_bound(value, meaning_of(name).unit) if bound else spell_metric(name, value)) in words


def test_a_number_is_called_certified_only_where_the_plan_is(run):
    label = meaning_of("clearance_planned_m").label
    assert label.endswith(CERTIFIED)
    assert "<td>≥ 61.20 mm</td>" in metrics(run).html
    followed = replace(run, plan=replace(run.plan, status="undecided"))
    assert "<td>61.20 mm, not certified</td>" in metrics(followed).html
    assert "<td>61.20 mm, not certified</td>" in side_by_side([run, followed]).html


def test_report_contains_every_constraint_of_the_certificate(report, run):
    _, structure = report
    for constraint in run.plan.certificate.constraints:
        assert constraint.name in structure.words
        assert spell_bound(constraint.margin, constraint.unit) in structure.words


def test_what_uncertainty_takes_stands_in_the_report(stopped_run, one_figure, tmp_path):
    margin = UncertainMargin("m", 0.004, 0.001, 0.003, {"noise": 0.002, "scale": 0.0025})
    found = RiskPlan(
        True,
        stopped_run.plan,
        0.01,
        0.0035,
        0.0066,
        2000,
        0.003,
        0.5,
        1.0,
        lambda: RiskReasons({"clearance obstacle 0": margin}, "most of it scale"),
    )
    write_report(tmp_path, [replace(stopped_run, risk=found)])
    words = " ".join(read(tmp_path)[1].words)
    for expected in ("0.66%", "noise 2.00 mm, scale 2.50 mm", "most of it scale", "left at that risk"):
        assert expected in words


def test_verdict_comes_before_every_figure_and_table(report):
    page, _ = report
    assert page.index("Converged") < page.index("<img")
    assert page.index("Converged") < page.index("<table")


def test_a_stopped_run_of_an_unknown_task_with_evil_words(stopped_run, one_figure, tmp_path):
    """Words from files are escaped; the reason leads; without the paper's task there is no paper's table."""
    evil = '<script>alert("x")</script>'
    task = stopped_run.task.model_copy(update={"summary": evil, "name": "my-own"})
    log = RunLog([], {("<b>forearm", "obstacle 0")}, "feature_loss", f"3 of 9 points are usable {evil}")
    metrics = {**stopped_run.metrics, "reason": evil, "<i>odd": evil}
    write_report(tmp_path, [replace(stopped_run, task=task, log=log, metrics=metrics)])
    page, structure = read(tmp_path)
    assert not structure.wrong
    assert not set(structure.tags) & {"script", "b", "i"}
    assert "<script" not in page
    assert evil in structure.words
    assert "The paper's numbers and ours" not in structure.words
    assert "omniservo run TASK.yaml --method certified" in structure.words


def test_methods_stand_side_by_side(run, made_up_run, one_figure, tmp_path):
    classical = made_up_run(method="ibvs", steps=6)
    classical.log.contacts.add(("forearm", "obstacle 0"))
    short = classical.task.planning.visibility_margin - 0.5
    classical.metrics.update(
        contacts=[["forearm", "obstacle 0"]], clearance_executed_m=0.021, visibility_executed_px=short
    )
    write_report(tmp_path, [run, classical])
    page, structure = read(tmp_path)
    assert not structure.wrong
    assert "Touched" in structure.words
    assert "Nothing was planned" in page
    assert "forearm and obstacle 0" in structure.words
    assert page.count("data:image/gif") == 2
    assert page.count('alt="Distance to the obstacles Certified plan"') == 1
    assert page.count('alt="Distance to the obstacles Classical servo, no plan"') == 1
    assert structure.words.count("Certificate") == 1
    of_joints = {word for word in structure.words if word.startswith("Joint path")}
    assert of_joints == {"Joint path: Certified plan"}
    assert '<span class="no">21.00 mm</span>' in page
    assert f'<span class="no">{short:.2f} px</span>' in page, "in view, but by less than is required"
    assert "omniservo run paper-example-1 --method certified --method ibvs" in structure.words


def test_a_point_that_left_the_view_is_said_and_marked(run):
    """The distance to the image's limits does not exist there: a dash would say that nothing is known."""
    lost = replace(run, metrics={**run.metrics, "visibility_executed_px": None})
    said = "a point left the camera&#x27;s view"
    assert f"<dt>{EXECUTED}</dt><dd>{said}</dd>" in key_numbers(lost).html
    assert f'<span class="no">{said}</span>' in side_by_side([run, lost]).html
    words = {**lost.metrics, "plan_status": "certified", "planning_seconds": None, "estimation_seconds": 1e-3}
    assert any(line.endswith("but a point left the camera's view") for line in run_summary(words))


def test_a_stopped_run_is_named_after_its_reason(stopped_run):
    assert verdict_of(stopped_run).word == "Stopped: feature loss"
    assert "3 of 9 points are usable" in verdict_of(stopped_run).sentence


def test_no_results_are_refused(tmp_path):
    with pytest.raises(InputError, match="at least one"):
        write_report(tmp_path, [])


def test_contact_outweighs_convergence(run):
    touched = replace(run, log=RunLog(run.log.rows, {("wrist", "obstacle 0")}))
    assert not verdict_of(touched).good
    assert "wrist and obstacle 0" in verdict_of(touched).sentence


def test_the_moment_of_the_first_contact_is_named(run):
    rows = [replace(row, arm_clearance=-1e-3 if k > 4 else 0.01) for k, row in enumerate(run.log.rows)]
    touched = replace(run, log=RunLog(rows, {("wrist", "obstacle 0")}))
    assert f"first at {rows[5].time:.2f} s" in verdict_of(touched).sentence


@pytest.mark.parametrize(
    ("value", "words"),
    [
        (0.0, "0"),
        (0.041, "0.0410"),
        (5.278, "5.28"),
        (61.266, "61.27"),
        (874.4, "874"),
        (-19.5, "−19.50"),
        (2e-9, "2.0e−09"),
    ],
)
def test_numbers_keep_the_digits_that_matter(value, words):
    assert significant(value) == words


@pytest.mark.parametrize(
    ("value", "unit", "words"),
    [
        (0.0612, "m", "61.20 mm"),
        (3.073, "s", "3.07 s"),
        (8e-4, "s", "800 µs"),
        (0.0, "s", "0 µs"),
        (1.0, "rad", "57.30°"),
        (None, "px", "–"),
        (float("nan"), "m", "–"),
        (0.99, "1", "0.990"),
        (0.00525, "share", "0.525%"),
    ],
)
def test_quantities_are_given_in_units_people_read(value, unit, words):
    assert spell(value, unit) == words


@pytest.mark.parametrize(
    ("value", "words"), [(0.0649999, "≥ 64.99 mm"), (0.065, "≥ 65.00 mm"), (0.0, "≥ 0 mm"), (None, "–")]
)
def test_a_proven_bound_is_rounded_down(value, words):
    assert spell_bound(value, "m") == words


@pytest.mark.parametrize(
    ("value", "bound", "unit", "less"),
    [(100.51, 100.53, "px", False), (99.4, 100.53, "px", True), (0.06498, 0.065, "m", True)],
)
def test_less_than_certified_is_said_of_what_is_written(value, bound, unit, less):
    assert reads_less(value, bound, unit) == less


def test_the_verdict_has_the_colour_of_what_happened(run, stopped_run):
    assert 'class="verdict good"' in verdict(run, named=False).html
    assert 'class="verdict bad"' in verdict(stopped_run, named=False).html
