"""One row of parts of other pictures, for the README: strip.png in the folder that is named."""

import pathlib
import sys

from PIL import Image

HEIGHT = 260
#: Picture, and the part of it: left, top, right, bottom.
PARTS = (
    ("forging_steps", (0.02, 0.0, 0.40, 1.0)),
    ("ironing", (0.2, 0.0, 1.0, 0.53)),
    ("cattaneo_mindlin", (0.513, 0.497, 1.0, 1.0)),
    ("ring_compression", (0.0, 0.0, 0.435, 1.0)),
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
    strip = Image.new("RGB", (sum(part.width for part in parts), HEIGHT), "white")
    x = 0
    for part in parts:
        strip.paste(part, (x, 0))
        x += part.width
    few = strip.quantize(256, Image.Quantize.MAXCOVERAGE, dither=Image.Dither.NONE)
    few.save(folder / "strip.png", optimize=True)


if __name__ == "__main__":
    main()
