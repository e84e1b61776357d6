"""Join parts of other pictures in one row for the README: strip.png in the given folder."""

import pathlib
import sys

from PIL import Image

HEIGHT = 240
#: Pixels between two parts.
BETWEEN = 14
#: Picture, and the part that is used: left, top, right, bottom.
PARTS = (
    ("closed_die", (0.699, 0.19, 0.93, 0.425)),
    ("closed_die", (0.355, 0.60, 0.642, 0.905)),
    ("closed_die", (0.643, 0.63, 0.9225, 0.995)),
    ("oring", (0.327, 0.284, 0.579, 0.717)),
    ("gear_pair", (0.054, 0.20, 0.262, 0.835)),
)


def main():
    folder = pathlib.Path(sys.argv[1])
    parts = []
    for name, box in PARTS:
        with Image.open(folder / f"{name}.png") as picture:
            size = picture.size * 2
            part = picture.convert("RGB").crop(
                [round(f * edge) for f, edge in zip(box, size, strict=True)]
            )
        width = round(part.width * HEIGHT / part.height)
        parts.append(part.resize((width, HEIGHT), Image.Resampling.LANCZOS))
    width = sum(part.width + BETWEEN for part in parts) - BETWEEN
    strip = Image.new("RGB", (width, HEIGHT), "white")
    x = 0
    for part in parts:
        strip.paste(part, (x, 0))
        x += part.width + BETWEEN
    few = strip.quantize(256, Image.Quantize.MAXCOVERAGE, dither=Image.Dither.NONE)
    few.save(folder / "strip.png", optimize=True)


if __name__ == "__main__":
    main()
