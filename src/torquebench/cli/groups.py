"""Groups of commands that contain operations only."""

import typer

from torquebench.cli.options import HELP_MARKUP

__all__ = ["bench", "evaluate"]


def _group(name: str, words: str) -> typer.Typer:
    app = typer.Typer(
        name=name,
        add_completion=False,
        help=words,
        rich_markup_mode=HELP_MARKUP,
        no_args_is_help=True,
    )

    @app.callback()
    def group() -> None:
        """Keep the name of a group's only command, which Typer would leave out."""

    app.info.help = words
    return app


evaluate = _group("evaluate", "Evaluate tables that were measured on any bench.")
bench = _group("bench", "Describe a bench by its instruments.")
