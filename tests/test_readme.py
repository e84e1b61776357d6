"""The README's examples run as they stand."""

import pathlib
import re

import numpy as np
import pytest

README = pathlib.Path(__file__).resolve().parent.parent / "README.md"


def names_after(marker):
    """What the example that contains a word leaves behind."""
    examples = re.findall(r"```python\n(.*?)```", README.read_text(encoding="utf-8"), re.DOTALL)
    code = next(example for example in examples if marker in example)
    out = {}
    exec(compile(code, "README.md", "exec"), out)
    return out


@pytest.fixture(scope="module")
def names():
    return names_after("def block")


def test_example(names):
    contact, problem = names["contact"], names["problem"]
    total = names["force"][2]
    opposite = contact.force("master")[2]
    # Between the stiffness in uniaxial stress (free sides) and uniaxial strain (none) of 1e4, 3e4.
    stress = 0.02 / (1 / 1e4 + 1 / 3e4)
    confined = (1 - 0.3) / (1 + 0.3) / (1 - 2 * 0.3)
    assert stress < total < confined * stress
    assert abs(total + opposite) < 1e-12 * total
    assert problem.snes.getIterationNumber() <= 8
    assert np.all(contact.active())


def test_forging():
    """The last force is that of the closed form, half a step before the end."""
    names = names_after("TimeStepper")
    height = 15 - 10 * 0.275
    area = np.pi * 10**2 * 15 / height
    expected = area * 50 * np.sqrt(3) ** 1.15 * (10 / height) ** 0.15
    assert np.isclose(-names["force"][1], expected, rtol=0.01)
