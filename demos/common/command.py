"""Command lines of the demos: options are fields of a dataclass, results are one flat object."""

import argparse
import dataclasses
import json
import os
import pathlib
import typing

from mpi4py import MPI

FORMULATIONS = ("master-slave", "double-pass", "quasi-symmetric")
#: Choices of the options that have these names and no choices of their own.
CHOICES = {
    "formulation": FORMULATIONS,
    "quadrature": ("nodal", "overlay"),
    "enforcement": ("penalty", "augmented-lagrangian"),
    "normals": ("facet", "bisector"),
    "sliding": ("small", "finite"),
    "constraints": ("nodes", "points"),
}


def option(default, help=None, **more):
    """A field of a demo's parameters that is an option of its command line as well.

    Args:
        default: Value of the field.
        help: What --help says of it.
        more: What else argparse's ``add_argument`` takes; ``name``, if it is not that of the field.
    """
    return dataclasses.field(default=default, metadata={"help": help} | more)


class Command:
    """A demo's command line.

    Args:
        doc: What --help says first.
        parameters: Dataclass whose fields made by ``option`` are options.
        plot: What --plot draws.
    """

    def __init__(self, doc, parameters, plot):
        self.parameters = parameters
        self.parser = argparse.ArgumentParser(
            description=doc,
            formatter_class=argparse.RawDescriptionHelpFormatter,
            argument_default=argparse.SUPPRESS,
        )
        for field in dataclasses.fields(parameters):
            if field.metadata:
                self._add_option(field)
        self.add_file("--json", output_file, "write results as JSON")
        self.add_file("--plot", picture_file, plot)
        self.error = self.parser.error

    def _add_option(self, field):
        settings = dict(field.metadata)
        name = settings.pop("name", "--" + field.name.replace("_", "-"))
        if field.type is bool:
            settings["action"] = "store_true"
        else:
            first, *_ = typing.get_args(field.type) or (field.type,)  # float of float | None
            settings = {"type": first, "choices": CHOICES.get(field.name)} | settings
            settings.setdefault("metavar", METAVARS.get(settings["type"]))
        self.parser.add_argument(name, dest=field.name, **settings)

    def add_file(self, name, kind, help=None):
        """An option that names a file to be written."""
        self.parser.add_argument(name, type=kind, metavar="FILE", default=None, help=help)

    def add_switch(self, name, help):
        """An option without a value that is no parameter."""
        self.parser.add_argument(name, action="store_true", default=False, help=help)

    def refuse(self, p, names, reason):
        """End if any of these parameters is not its default."""
        default = self.parameters()
        given = [name for name in names if getattr(p, name) != getattr(default, name)]
        if given:
            self.error(", ".join("--" + n.replace("_", "-") for n in given) + f": {reason}")

    def parse(self):
        """Parameters, and the options that are none; of the former ``given`` has those named."""
        options = self.parser.parse_args()
        names = [f.name for f in dataclasses.fields(self.parameters) if hasattr(options, f.name)]
        options.given = {name: getattr(options, name) for name in names}
        try:
            p = self.parameters(**options.given)
        except ValueError as error:
            self.error(str(error))
        made = getattr(p, "formulation", None), getattr(p, "enforcement", None)
        if made == ("double-pass", "augmented-lagrangian"):
            self.error("--enforcement: multipliers of double-pass contact cannot close every gap")
        return p, options


# --- Types of options


def output_file(text):
    """A file that can be written: refused at the start, not at the end of a run."""
    path = pathlib.Path(text).absolute()
    if path.is_dir() or not path.parent.is_dir():
        raise argparse.ArgumentTypeError(f"there is no folder {path.parent}, or {path} is one")
    if not os.access(path if path.exists() else path.parent, os.W_OK):
        raise argparse.ArgumentTypeError(f"{path} cannot be written")
    return text


def picture_file(text, kinds=None):
    """The file of --plot, if matplotlib is there and can write that kind of file."""
    try:
        from matplotlib.backend_bases import FigureCanvasBase
    except ImportError:
        raise argparse.ArgumentTypeError("pictures need matplotlib, which is missing") from None
    kinds = kinds or sorted(FigureCanvasBase.get_supported_filetypes())
    if text.rpartition(".")[2].lower() not in kinds:
        raise argparse.ArgumentTypeError(f"{text} must end in .{' or .'.join(kinds)}")
    return output_file(text)


def film_file(text):
    """The file of --animate: a GIF."""
    return picture_file(text, ["gif"])


def count(text):
    """A number of cells or of points."""
    return _checked(int(text), lambda value: value >= 1, "must be at least 1")


def seed(text):
    """Of a random generator."""
    return _checked(int(text), lambda value: value >= 0, "must not be negative")


def shift(text):
    """Of nodes, in units of the cells, such that the mesh remains valid."""
    return _checked(float(text), lambda value: 0 <= value < 0.5, "must be at least 0 and below 0.5")


def stiffness(text):
    """Penalty: "auto" or a positive number."""
    message = 'must be "auto" or a positive number'
    return (
        text if text == "auto" else _checked(float(text), lambda v: 0 < v < float("inf"), message)
    )


def _checked(value, holds, message):
    if not holds(value):
        raise argparse.ArgumentTypeError(message)
    return value


#: What --help calls values of these types.
METAVARS = {count: "N", seed: "S", shift: "F", stiffness: "auto|FLOAT"}


# --- Results, on rank 0


def say(line=""):
    """Print a line, on rank 0."""
    if MPI.COMM_WORLD.rank == 0:
        print(line, flush=True)


def report(result, filename=None, style="", more=None):
    """Print results and write them as JSON, on rank 0.

    Args:
        result: What the JSON object has.
        filename: Its file, if any.
        style: How values are formatted.
        more: What is printed besides.
    """
    printed = result | (more or {})
    width = max(map(len, printed)) + 2
    say("\n".join(f"{key:{width}}{value:{style}}" for key, value in printed.items()))
    save(result, filename)


def save(result, filename):
    """Write a flat JSON object, on rank 0."""
    if filename and MPI.COMM_WORLD.rank == 0:
        with open(filename, "w") as file:
            json.dump(result, file, indent=2, default=lambda value: value.item())  # NumPy's


def print_rows(rows, **columns):
    """Print a table, on rank 0; columns are keys of the rows, with their heads and formats."""
    lines = [[head for head, _ in columns.values()]]
    lines += [[f"{row[key]:{style}}" for key, (_, style) in columns.items()] for row in rows]
    widths = [max(map(len, column)) for column in zip(*lines, strict=True)]
    sides = ["<" if isinstance(rows[-1][key], str) else ">" for key in columns]
    for line in lines:
        cells = zip(line, sides, widths, strict=True)
        say("  ".join(f"{text:{side}{width}}" for text, side, width in cells).rstrip())
