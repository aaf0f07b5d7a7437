"""A command whose parameters are dataclasses of options is called as one that has each option itself."""

from dataclasses import dataclass
from typing import Annotated

import pytest
import typer
from typer.testing import CliRunner

from omniservo.cli.grouped import grouped


@dataclass(frozen=True)
class Size:
    width: Annotated[int, typer.Option("--width", help="In px.")]
    height: Annotated[int, typer.Option("--height")] = 2
    strict: Annotated[bool, typer.Option("--strict")] = False


app = typer.Typer()


@app.command()
@grouped
def command(
    name: Annotated[str, typer.Argument()] = "none",
    *,
    size: Size,
    strict: Annotated[bool, typer.Option("--strict")] = False,
):
    """Say what is given."""
    typer.echo(f"{name} {size} {strict}")


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (["--width", "3"], f"none {Size(3)} False"),
        (["a", "--height", "5", "--width", "3"], f"a {Size(3, 5)} False"),
        (["--strict", "--width", "3"], f"none {Size(3, strict=True)} True"),
    ],
)
def test_fields_are_options_and_a_name_that_both_have_is_given_to_both(arguments, said):
    assert CliRunner().invoke(app, arguments).output.strip() == said


def test_a_field_without_a_default_is_needed_and_its_help_is_shown():
    assert CliRunner().invoke(app, []).exit_code == 2
    assert "In px." in CliRunner().invoke(app, ["--help"]).output
