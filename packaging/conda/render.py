"""Renders the recipe for every variant: with rattler-build, `pip install py-rattler-build`.

python3 packaging/conda/render.py
"""

import pathlib
import tempfile

from rattler_build import PlatformConfig, RenderConfig, Stage0Recipe, VariantConfig

HERE = pathlib.Path(__file__).resolve().parent
#: What conda-forge's pins say besides.
PINS = 'c_stdlib:\n  - sysroot\nc_stdlib_version:\n  - "2.17"\n'


def main():
    """Print the variants of two platforms, the second compiled on the first."""
    with tempfile.TemporaryDirectory() as folder:
        variants = pathlib.Path(folder) / "variants.yaml"
        variants.write_text((HERE / "variants.yaml").read_text() + PINS)
        config = VariantConfig.from_file(variants)
    recipe = Stage0Recipe.from_file(HERE / "recipe.yaml")
    for target in ("linux-64", "osx-arm64"):
        platform = PlatformConfig(
            target_platform=target, build_platform="linux-64", host_platform=target
        )
        for rendered in recipe.render(config, RenderConfig(platform=platform)):
            build = rendered.recipe.to_dict()["build"]["string"]
            variant = rendered.variant() if callable(rendered.variant) else rendered.variant
            print(target, build, variant["mpi"], variant["python"])


if __name__ == "__main__":
    main()
