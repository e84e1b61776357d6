"""Arguments that name a file to be written: refused at the start, not at the end of a run."""

import argparse
import os
import pathlib


def output_file(text):
    """The name, if a file can be written there."""
    path = pathlib.Path(text).absolute()
    if path.is_dir() or not path.parent.is_dir():
        raise argparse.ArgumentTypeError(f"there is no folder {path.parent}, or {path} is one")
    if not os.access(path if path.exists() else path.parent, os.W_OK):
        raise argparse.ArgumentTypeError(f"{path} cannot be written")
    return text
