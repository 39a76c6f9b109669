"""`torquebench evaluate`: the group of operations that evaluate tables of any bench."""

import typer

from torquebench.cli.options import HELP_MARKUP

app = typer.Typer(
    name="evaluate",
    add_completion=False,
    help="Evaluate tables that were measured on any bench.",
    rich_markup_mode=HELP_MARKUP,
    no_args_is_help=True,
)


@app.callback()
def _tables() -> None:
    """Evaluate tables that were measured on another bench."""
