"""Write the README's table *paper / ours* and its animation from runs made now: ``make readme``.

Times are warm: each task is run twice in this process, and the second run is the table's.
"""

from __future__ import annotations

import re
from pathlib import Path

from benchmarks.whole_job import whole_run

from omniservo.reporting import paper_table_markdown, write_animation

ROOT = Path(__file__).resolve().parents[1]
TASKS = ("paper-example-1", "paper-example-2")


def main() -> None:
    """Run both experiments of the paper and put what came out into README.md and docs/images."""
    for name in TASKS:  # the first runs load, or compile, the code that the runs of the table are timed with
        whole_run(name)
    results = [whole_run(name) for name in TASKS]
    for name, result in zip(TASKS, results, strict=True):
        write_animation(result, ROOT / "docs" / "images" / f"{name}.gif")
    readme = ROOT / "README.md"
    table = paper_table_markdown(results).strip()
    begin, end = "<!-- paper-table -->", "<!-- end of paper-table -->"
    text = re.sub(f"{begin}.*?{end}", f"{begin}\n{table}\n{end}", readme.read_text(), flags=re.DOTALL)
    readme.write_text(text)


if __name__ == "__main__":
    main()
