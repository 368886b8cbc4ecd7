"""Every public name has a numpydoc docstring: parameters, returns, errors. numpydoc's own validation is the linter."""

import enum
import inspect
import pydoc

import pytest
from numpydoc.docscrape import ClassDoc
from numpydoc.validate import validate

import optid

# Sections that are no duty here (see also, examples, a longer summary), and matters of taste: a description may begin
# with a small letter; a summary may begin with any word.
NO_DUTY = {"SA01", "EX01", "ES01", "PR08", "RT04", "SS02", "SS03", "SS05", "YD01"}
MODULES = ("datasets", "fleet", "laws")


def members(thing):
    """The documented members of a class that optid itself defines."""
    for name, _ in inspect.getmembers(thing):
        home = next((kind for kind in thing.__mro__ if name in vars(kind)), None)
        if name.startswith("_") or home is None or not home.__module__.startswith("optid"):
            continue
        static = inspect.getattr_static(thing, name)
        if inspect.isfunction(static) or isinstance(static, (property, classmethod, staticmethod)):
            yield f"{home.__module__}.{home.__qualname__}.{name}"


def public():
    """Dotted names of all that is public."""
    found = {}
    for name in optid.__all__:
        thing = getattr(optid, name)
        if name in MODULES:
            listed = getattr(thing, "__all__", None) or [
                own
                for own, value in vars(thing).items()
                if not own.startswith("_") and getattr(value, "__module__", "") == thing.__name__
            ]
            things = [getattr(thing, own) for own in listed]
        else:
            things = [thing] if callable(thing) else []
        for one in things:
            found[f"{one.__module__}.{one.__qualname__}"] = None
            found |= dict.fromkeys(members(one) if inspect.isclass(one) else ())
    return list(found)


def complaints(name):
    """What the linter says; a class's attributes count as its parameters."""
    errors = [(code, words) for code, words in validate(name)["errors"] if code not in NO_DUTY]
    thing = pydoc.locate(name)
    if not inspect.isclass(thing):
        return errors
    if (
        issubclass(thing, enum.Enum)
        or getattr(thing, "_is_protocol", False)
        or thing.__init__ is Exception.__init__
    ):
        return [(code, words) for code, words in errors if code != "PR01"]
    told = {
        part.strip()
        for kind in thing.__mro__
        if kind.__module__.startswith("optid")
        for section in ("Attributes", "Parameters")
        for entry in ClassDoc(kind, config={"show_class_members": False})[section]
        for part in entry.name.split(",")
    }
    silent = [p for p in inspect.signature(thing).parameters if p not in told and not p.startswith("_")]
    return [(code, words) for code, words in errors if code != "PR01" or silent]


def test_nothing_public_is_left_out():
    plain = {name for name in optid.__all__ if not callable(getattr(optid, name))}
    assert plain == {*MODULES, "__version__"}
    named = {name.rpartition(".")[2] for name in public()}
    assert {name for name in optid.__all__ if name not in plain} <= named
    assert set(optid.fleet.__all__) <= named
    assert len(public()) > 150  # with the members of classes


@pytest.mark.parametrize("name", public())
def test_a_public_name_is_documented(name):
    assert complaints(name) == []


def test_the_linter_sees_what_is_missing(monkeypatch):
    monkeypatch.setattr(optid.fit, "__doc__", "Fit parameters.")
    assert {code for code, _ in complaints("optid.api.fitting.fit")} >= {"PR01", "RT01"}
