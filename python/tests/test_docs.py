"""What the documentation shows runs."""

import doctest
import inspect
import pathlib
import re

import mbkd
import numpy as np

GUIDE = pathlib.Path(__file__).parents[2] / "docs" / "python.md"


def test_snippets_of_the_guide_run():
    vertices = np.float32([[0, 0, 0], [1, 0, 0], [0, 1, 0]])
    names = {
        "vertices": vertices,
        "faces": [[0, 1, 2]],
        "origins": [[0.2, 0.2, 1], [5, 5, 1]],
        "directions": [0, 0, -1],
        "points": [[0.0, 0, 3], [1, 1, 1]],
        "times": [0.0, 0.5],
        "centers": np.float64([[0.2, 0.2, 3], [9, 9, 9]]),
        "radii": 0.5,
    }
    snippets = re.findall(r"```python\n(.*?)```", GUIDE.read_text(), re.DOTALL)
    assert len(snippets) >= 2
    for snippet in snippets:
        exec(compile(snippet, str(GUIDE), "exec"), names)
    assert names["hits"].triangle.tolist() == [0, -1] and names["hits"].mesh.tolist() == [0, -1]
    assert len(names["lists"]) == 100_000


def test_examples_of_docstrings_run():
    for module in (mbkd.instances, mbkd.points, mbkd.rays, mbkd._traced):
        done = doctest.testmod(module)
        assert done.attempted > 0 and done.failed == 0


def test_everything_public_has_a_docstring():
    for name in mbkd.__all__:
        thing = getattr(mbkd, name)
        assert thing.__doc__, name
        for member in dir(thing) if isinstance(thing, type) else ():
            value = getattr(thing, member)
            if (callable(value) or isinstance(value, property)) and not member.startswith("_"):
                assert value.__doc__, f"{name}.{member}"


def test_no_method_hides_its_arguments():
    for name in mbkd.__all__:
        for member, value in inspect.getmembers(getattr(mbkd, name), inspect.isfunction):
            kinds = {parameter.kind for parameter in inspect.signature(value).parameters.values()}
            assert member.startswith("_") or inspect.Parameter.VAR_KEYWORD not in kinds, f"{name}.{member}"
