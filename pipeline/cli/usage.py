"""Help without Python's types, and one line for each usage error."""

from collections.abc import Callable
from typing import Any

import typer
from typer.core import TyperArgument, TyperCommand, TyperGroup

from pipeline.cli.renamed_options import present_name
from pipeline.terminal import console
from recorders.text.wording import did_you_mean


class Verb(TyperCommand):
    """A verb whose help shows what each argument and option takes, without Python's name for it."""

    def parse_args(self, ctx: Any, args: list[str]) -> list[str]:
        """Parse the command line; former names of options are taken, too."""
        ctx.token_normalize_func = present_name(ctx.command_path.partition(" ")[2])
        return super().parse_args(ctx, args)

    def format_options(self, ctx: Any, formatter: Any) -> None:
        """Write the arguments, then the options."""
        _write_parameters(self, ctx, formatter)


class VerbGroup(TyperGroup):
    """A verb that has verbs of its own beside what it does alone; its options stand before none of these."""

    def format_options(self, ctx: Any, formatter: Any) -> None:
        """Write the options, then the verbs."""
        _write_parameters(self, ctx, formatter)
        self.format_commands(ctx, formatter)


def refuse_options(ctx: typer.Context) -> None:
    """Raise a usage error where options of a `VerbGroup` stand before one of its own verbs, which would ignore them."""
    names = [param.opts[0] for param in ctx.command.params if _is_given(ctx, param.name)]
    if names:
        raise typer.BadParameter(f"{', '.join(names)}: expected no option before {ctx.invoked_subcommand}", ctx=ctx)


def _is_given(ctx: typer.Context, name: str | None) -> bool:
    source = None if name is None else ctx.get_parameter_source(name)
    return source is not None and source.name == "COMMANDLINE"


def _write_parameters(command: Any, ctx: Any, formatter: Any) -> None:
    """Write the arguments, then the options, of a command."""
    records: dict[str, list[tuple[str, str]]] = {"Arguments": [], "Options": []}
    for param in command.get_params(ctx):
        record = param.get_help_record(ctx)
        if record is not None and isinstance(param, TyperArgument):
            records["Arguments"].append((param.display_name_raw, record[1]))
        elif record is not None:
            records["Options"].append(record)
    for title, rows in records.items():
        if rows:
            with formatter.section(title):
                formatter.write_dl(rows)


class Verbs(typer.Typer):
    """A group of verbs, whose help is as `Verb` writes it."""

    def command(
        self, name: str | None = None, *, cls: type[TyperCommand] | None = Verb, **settings: Any
    ) -> Callable[..., Any]:
        """Return what registers a function as a verb."""
        return super().command(name, cls=cls, **settings)


def help_without_verb(ctx: typer.Context) -> None:
    """Print the help, and end with status 2, where the command line names no verb."""
    if ctx.invoked_subcommand is None:
        console.block(ctx.get_help())
        raise typer.Exit(2)


def usage_line(error: Any) -> str:
    """Return the line for a usage error of typer's: what was expected, what was found, and whose help to read."""
    where = "reenact" if error.ctx is None else error.ctx.command_path
    return f"{_what(error).rstrip('.')} (`{where} --help` shows what there is)"


def _what(error: Any) -> str:
    if hasattr(error, "option_name") and hasattr(error, "possibilities"):  # no such option
        return f"no such option {error.option_name}{_nearest_option(error)}"
    invalid = error.__cause__
    if hasattr(invalid, "errors") and error.param is not None:  # a value that cannot be one of this option's
        found = invalid.errors()[0]["input"]
        return f"{'/'.join(error.param.opts)}: expected {_expected(error.param)}, found {str(found)!r:.60}"
    message: str = error.format_message()
    return message[:1].lower() + message[1:]


def _nearest_option(error: Any) -> str:
    """Return the question whether another option was meant, if one is near: `--otu` or `-o` for `--out`."""
    if error.ctx is None:
        return ""
    params = error.ctx.command.get_params(error.ctx)
    names = [name for param in params for name in (*param.opts, *param.secondary_opts) if name.startswith("-")]
    return did_you_mean(error.option_name, names)


def _expected(param: Any) -> str:
    """Return what a numeric option takes, in words."""
    words = "a whole number" if param.type_descriptor.annotation is int else "a number"
    if param.min is not None and param.max is not None:
        return f"{words} from {param.min:g} to {param.max:g}"
    if param.min is not None:
        return f"{words}, at least {param.min:g}"
    return f"{words}, at most {param.max:g}" if param.max is not None else words
