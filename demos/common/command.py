"""Command lines of the demos: options are fields of a dataclass, results are one flat object."""

import argparse
import dataclasses
import json
import os
import pathlib
import typing

from mpi4py import MPI

FORMULATIONS = ("master-slave", "double-pass", "quasi-symmetric")
#: Choices of the options with these names, unless an option has its own choices.
CHOICES = {
    "formulation": FORMULATIONS,
    "quadrature": ("nodal", "overlay"),
    "enforcement": ("penalty", "augmented-lagrangian"),
    "normals": ("facet", "bisector"),
    "sliding": ("small", "finite"),
    "constraints": ("nodes", "points"),
}


def option(default, help=None, **more):
    """Make a field of the parameters of a demo that is also an option of its command line.

    Args:
        default: Default value of the field.
        help: Description for --help.
        more: Further arguments of argparse's ``add_argument``; also ``name``, if it differs from
            the name of the field.
    """
    return dataclasses.field(default=default, metadata={"help": help} | more)


class Command:
    """Command line of a demo.

    Args:
        doc: First text that --help prints.
        parameters: Dataclass; its fields made by ``option`` become options.
        plot: Description of the picture that --plot draws.
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
            first, *_ = typing.get_args(field.type) or (field.type,)  # the float of float | None
            settings = {"type": first, "choices": CHOICES.get(field.name)} | settings
            settings.setdefault("metavar", METAVARS.get(settings["type"]))
        self.parser.add_argument(name, dest=field.name, **settings)

    def add_file(self, name, kind, help=None):
        """Add an option that names an output file."""
        self.parser.add_argument(name, type=kind, metavar="FILE", default=None, help=help)

    def add_switch(self, name, help):
        """Add an option without a value that is not a parameter."""
        self.parser.add_argument(name, action="store_true", default=False, help=help)

    def refuse(self, p, names, reason):
        """Stop with an error if any of these parameters differs from its default."""
        default = self.parameters()
        given = [name for name in names if getattr(p, name) != getattr(default, name)]
        if given:
            self.error(", ".join("--" + n.replace("_", "-") for n in given) + f": {reason}")

    def parse(self):
        """Return the parameters and the other options; ``given`` has the parameters in use."""
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
    """Check at the start of a run, not at its end, that a file can be written."""
    path = pathlib.Path(text).absolute()
    if path.is_dir() or not path.parent.is_dir():
        raise argparse.ArgumentTypeError(f"there is no folder {path.parent}, or {path} is one")
    if not os.access(path if path.exists() else path.parent, os.W_OK):
        raise argparse.ArgumentTypeError(f"{path} cannot be written")
    return text


def picture_file(text, kinds=None):
    """Check the file of --plot: matplotlib must be installed and support its format."""
    try:
        from matplotlib.backend_bases import FigureCanvasBase
    except ImportError:
        raise argparse.ArgumentTypeError("pictures need matplotlib, which is missing") from None
    kinds = kinds or sorted(FigureCanvasBase.get_supported_filetypes())
    if text.rpartition(".")[2].lower() not in kinds:
        raise argparse.ArgumentTypeError(f"{text} must end in .{' or .'.join(kinds)}")
    return output_file(text)


def film_file(text):
    """Check the file of --animate, which must be a GIF."""
    return picture_file(text, ["gif"])


def count(text):
    """Convert a number of cells or of points."""
    return _checked(int(text), lambda value: value >= 1, "must be at least 1")


def seed(text):
    """Convert the seed of a random generator."""
    return _checked(int(text), lambda value: value >= 0, "must not be negative")


def shift(text):
    """Convert a shift of nodes, in units of the cells, for which the mesh remains valid."""
    return _checked(float(text), lambda value: 0 <= value < 0.5, "must be at least 0 and below 0.5")


def stiffness(text):
    """Convert a penalty: "auto" or a positive number."""
    message = 'must be "auto" or a positive number'
    return (
        text if text == "auto" else _checked(float(text), lambda v: 0 < v < float("inf"), message)
    )


def _checked(value, holds, message):
    if not holds(value):
        raise argparse.ArgumentTypeError(message)
    return value


#: Names of the values of these types in --help.
METAVARS = {count: "N", seed: "S", shift: "F", stiffness: "auto|FLOAT"}


# --- Results, on rank 0


def say(line=""):
    """Print a line; on rank 0."""
    if MPI.COMM_WORLD.rank == 0:
        print(line, flush=True)


def report(result, filename=None, style="", more=None):
    """Print results and write them as JSON; on rank 0.

    Args:
        result: Contents of the JSON object.
        filename: Name of the JSON file, if any.
        style: Format of the values.
        more: Further results that are only printed.
    """
    printed = result | (more or {})
    width = max(map(len, printed)) + 2
    say("\n".join(f"{key:{width}}{value:{style}}" for key, value in printed.items()))
    save(result, filename)


def save(result, filename):
    """Write a flat JSON object; on rank 0."""
    if filename and MPI.COMM_WORLD.rank == 0:
        with open(filename, "w") as file:
            json.dump(result, file, indent=2, default=lambda value: value.item())  # NumPy types


def print_rows(rows, **columns):
    """Print a table, on rank 0; columns maps keys of the rows to their headings and formats."""
    lines = [[head for head, _ in columns.values()]]
    lines += [[f"{row[key]:{style}}" for key, (_, style) in columns.items()] for row in rows]
    widths = [max(map(len, column)) for column in zip(*lines, strict=True)]
    sides = ["<" if isinstance(rows[-1][key], str) else ">" for key in columns]
    for line in lines:
        cells = zip(line, sides, widths, strict=True)
        say("  ".join(f"{text:{side}{width}}" for text, side, width in cells).rstrip())
