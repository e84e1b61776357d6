"""The README's example runs as it stands."""

import pathlib
import re

import numpy as np
import pytest

README = pathlib.Path(__file__).resolve().parent.parent / "README.md"


@pytest.fixture(scope="module")
def names():
    code = re.findall(r"```python\n(.*?)```", README.read_text(encoding="utf-8"), re.DOTALL)[0]
    out = {}
    exec(compile(code, "README.md", "exec"), out)
    return out


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
