"""One study out of the folders that its shards were run in."""

from __future__ import annotations

import os
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

from omniservo.errors import InputError
from omniservo.files import copy_whole, write_whole
from omniservo.studies.study import Study
from omniservo.studies.study_folder import HEADER, StudyHeader, read_header, refuse_other
from omniservo.studies.study_parts import StudyPart, part_count, part_file, read_part
from omniservo.verification import PlanFileError, verify_plan


def merge_studies(
    folders: Sequence[Path],
    work: Path,
    progress: Callable[[str, float], object] = lambda stage, share: None,
) -> tuple[Study, int]:
    """Fill the empty folder ``work`` with the parts of several; return the study, and its certificates.

    Of a part that is in several folders the first is taken. Every plan of a row that is said to be certified
    is judged again by the independent verifier.

    Raises:
        InputError: folders of several studies or versions, a part that is missing or damaged, or a
            certificate that does not hold; the message names the file.
    """
    headers = [read_header(folder) for folder in folders]
    first = headers[0]
    for folder, header in zip(folders, headers, strict=True):
        refuse_other(folder, header, first.study, first.version)
    study, certificates = first.study, 0
    count = part_count(study)
    holders = ((number, _found(folders, number)) for number in range(count))
    found = {number: holder for number, holder in holders if holder is not None}
    missing = [number for number in range(count) if number not in found]
    if missing:
        named = ", ".join(part_file(Path(), number).name for number in missing[:5])
        raise InputError(f"{len(missing)} of {count} parts are in none of the folders: {named}")
    for number, holder in found.items():  # what is damaged is named before minutes go into certificates
        read_part(study, first.version, holder, number)
    (work / "parts").mkdir()
    for number, holder in found.items():
        source = part_file(holder, number)
        certificates += _verified(read_part(study, first.version, holder, number), source)
        _taken_over(source, part_file(work, number))
        progress("verifying certificates", (number + 1) / count)
    machines = {tuple(m.items()): m for header in headers for m in header.machines}
    write_whole(work / HEADER, StudyHeader(study, first.version, tuple(machines.values())).to_json())
    return study, certificates


def _found(folders: Sequence[Path], number: int) -> Path | None:
    return next((folder for folder in folders if part_file(folder, number).exists()), None)


def _verified(part: StudyPart, source: Path) -> int:
    """Return how many certificates of a part hold: all of them.

    Raises:
        InputError: one does not, or a row has none that says it has.
    """
    claimed = [row.row for row in part.rows if row.certified]
    if claimed != sorted(part.plans):
        raise InputError(f"{source}: rows said to be certified, and rows with a plan, are not the same")
    for number in claimed:
        if reason := _fault(part.plans[number]):
            raise InputError(f"{source}: row {number}: its certificate does not hold: {reason}")
    return len(claimed)


def _fault(plan: dict[str, Any]) -> str:
    try:
        judged = verify_plan(plan)
    except PlanFileError as error:
        return str(error)
    if judged.status == "certified":
        return ""
    return f"{judged.status}: {'; '.join(judged.reasons[:1])}"


def _taken_over(source: Path, target: Path) -> None:
    """Let a part be in another folder, too: without a copy where both are on one disk."""
    try:
        os.link(source, target)
    except OSError:
        copy_whole(source, target)
