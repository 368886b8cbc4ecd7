"""The effects atlas: one page for each effect, from what the effect says of itself."""

from __future__ import annotations

import re
from collections.abc import Iterable
from pathlib import Path

from optid.core.parameter import Parameter
from optid.core.quantity import quantity, typeset
from optid.effects.anywhere import Anywhere
from optid.effects.effect import Effect
from optid.effects.library import DESCRIPTIONS, anywhere, built_in

KINDS = {
    "valve": "Valve: from the command to the spool",
    "flow": "Flow: valve flow, leaks, chamber pressures",
    "force": "Force: what acts on the moving mass",
    "drive": "Drive: from the command to the motor's torque",
    "sensor": "Sensors",
}
HEAD = """# Effects atlas

Every effect that optid can name, from its own file in `optid/effects`. A page has the law, what it does to a
recording, its smallest size worth a name, its look-alikes, and the experiment that shows it. The diagnosis and
`optid plan` use the same entries, so this atlas cannot differ from them.

The figures compare two simulated runs of a plant: the same reference and the same controller, without and with the
effect at a usual size. The controller acts on the sensor's reading, so the command differs as well. An effect that
needs strokes at full command is shown with those, without a controller.
"""


def effects() -> dict[str, Effect]:
    """All that have a page, by its name."""
    return {**built_in(), **{kind: made("SITE") for kind, made in anywhere().items()}}


def pages() -> dict[str, str]:
    """File name -> text."""
    every = effects()
    named = {f"{name}.md": _page(name, effect, every) for name, effect in every.items()}
    return {"index.md": _index(every), **named, "surrogates.md": _surrogates()}


def draw_figures(folder: Path) -> None:
    """A figure for every effect that a driven plant admits, set into its page with what it shows."""
    from studies.docs.extension.figures import draw
    from studies.docs.extension.runs import key, records

    for record in records():
        name = key(record.effect)
        said = draw(record, folder / f"{name}.png")
        sizes = _listed(record.effect, record.values)
        page = folder / f"{name}.md"
        shown = (
            f"```{{image}} {name}.png\n:class: record\n:alt: record without and with {name}\n```\n\n"
            f"On the plant `{record.plant.rpartition(':')[2]}`, with {sizes}, {said}."
        )
        page.write_text(page.read_text(encoding="utf-8").replace(NO_FIGURE, shown), encoding="utf-8")


NO_FIGURE = "No built-in plant of the atlas admits this effect, or the site was built without figures."


def _index(every: dict[str, Effect]) -> str:
    groups: dict[str, list[str]] = {}
    for name, effect in every.items():
        group = "any" if isinstance(effect, Anywhere) else effect.site
        groups.setdefault(group, []).append(name)
    order = [*KINDS, *sorted(set(groups) - {*KINDS, "any"}), "any"]
    parts = [HEAD]
    for group in order:
        title = "At any site" if group == "any" else KINDS.get(group, f"Site `{group}`")
        names = sorted(groups.get(group, ()))
        if not names:
            continue
        parts.append(f"\n## {title}\n\n| effect | law | look-alikes |\n|---|---|---|\n")
        parts += [
            f"| [{n}]({n}.md) | {_cell(every[n].law)} | {_names(every[n].look_alikes, every)} |\n"
            for n in names
        ]
    listing = "\n".join([*sorted(every), "surrogates"])
    parts.append("\nA mismatch without a named effect is described by [surrogates](surrogates.md).\n")
    parts.append(f"\n```{{toctree}}\n:hidden:\n\n{listing}\n```\n")
    return "".join(parts)


def _page(name: str, effect: Effect, every: dict[str, Effect]) -> str:
    doc = " ".join((type(effect).__doc__ or "").split("Args:")[0].split())
    where = (
        "any site of a plant" if isinstance(effect, Anywhere) else ", ".join(f"`{s}`" for s in effect.sites)
    )
    written = f"{name}@SITE" if isinstance(effect, Anywhere) else name
    return "\n".join(
        (
            f"# {name}\n",
            f"{_sentence(effect.law)}\n",
            "| | |\n|---|---|",
            f"| acts at | {where} |",
            f"| equation it changes | {_equation(effect.equation)} |",
            f"| follows | {', '.join(effect.depends_on)} |",
            f"| source | {_cell(effect.source)} |",
            f"| file | `{_file(effect)}` |\n",
            "## What it does to a record\n",
            f"{NO_FIGURE}\n",
            f"To be visible it needs {effect.needs}.\n",
            "## The law\n",
            f"{doc}\n",
            _parameters(effect),
            "## Smallest size worth a name\n",
            f"{_smallest(effect)}\n",
            "## Look-alikes, and the experiment that distinguishes them\n",
            f"{_alike(effect, every)}\n",
            f"{_sentence(effect.experiment) or 'No experiment is stated.'}\n",
            "## In a rig file\n",
            f"```toml\n{_table(written, effect)}```\n",
            f"A diagnosis says: *{_says(effect)}*.\n",
        )
    )


def _parameters(effect: Effect) -> str:
    rows = [
        f"| `{q.name}` | {_cell(q.about)} | {_unit(q.unit)} | {_value(q, q.default)} | {_bounds(q)} "
        f"| {_cell(q.source)} |"
        for q in effect.parameters
    ]
    head = "| parameter | is | unit | null or usual value | bounds | source |\n|---|---|---|---|---|---|\n"
    return head + "\n".join(rows) + "\n"


def _smallest(effect: Effect) -> str:
    sizes, units = effect.at_null(), {q.name: q.unit for q in effect.parameters}
    each = [
        f"`{name}` {quantity(least, units[name]) or least} from its null, {quantity(sizes[name], units[name])}"
        for name, least in effect.strength.items()
    ]
    few = " or ".join(each)
    return f"Below {few}, an effect is not named, even if it is statistically significant. The largest strength counts."


def _alike(effect: Effect, every: dict[str, Effect]) -> str:
    parts = []
    if effect.look_alikes:
        parts.append(f"Easily confused with {_names(effect.look_alikes, every)}.")
    for strength, other in effect.shares.items():
        parts.append(
            f"While the plant moves, `{strength}` acts like {_names((other,), every)}; only rest distinguishes them."
        )
    if effect.excludes:
        parts.append(f"It excludes {_names(effect.excludes, every)}.")
    return " ".join(parts) or "None is stated."


def _names(names: Iterable[str], every: dict[str, Effect]) -> str:
    return ", ".join(f"[{n}]({n}.md)" if n in every else f"`{n}`" for n in names) or "–"


def _table(written: str, effect: Effect) -> str:
    units = {q.name: q.unit for q in effect.parameters}
    key = f'"{written}"' if "@" in written else written
    lines = [f"[effects.{key}]"]
    for name, value in effect.usual[len(effect.usual) // 2].items():
        number = f"{value:.6g}"
        lines.append(f"{name} = {number}" if units[name] == "1" else f'{name} = "{number} {units[name]}"')
    return "\n".join(lines) + "\n"


def _says(effect: Effect) -> str:
    units, values = {q.name: q.unit for q in effect.parameters}, effect.usual[len(effect.usual) // 2]

    def filled(found: re.Match[str]) -> str:
        name = found.group(1)
        return quantity(values[name], units[name]) if name in values else name.replace("_", " ")

    return typeset(re.sub(r"{(\w+)}", filled, effect.says))


def _listed(effect: Effect, values: dict[str, float]) -> str:
    units = {q.name: q.unit for q in effect.parameters}
    return ", ".join(f"`{name}` = {quantity(value, units[name])}" for name, value in values.items())


def _surrogates() -> str:
    rows = "".join(
        f"| `{kind}` | {_cell(' '.join((made.__doc__ or '').split('Args:')[0].split()))} |\n"
        for kind, made in sorted(DESCRIPTIONS.items())
    )
    return (
        "# Surrogates: descriptions of a mismatch without a named effect\n\n"
        "Where no effect of the catalogue explains what is missing, the verdict is `unexplained`. The diagnosis then "
        "describes the mismatch by a form, so that the improved rig file predicts; a form never counts as a named "
        'effect. Rig files store it as `[effects."KIND@SITE@SIGNAL"]`.\n\n| kind | form |\n|---|---|\n' + rows
    )


def _file(effect: Effect) -> str:
    return type(effect).__module__.replace(".", "/") + ".py"


def _equation(equation: str) -> str:
    return (
        f"eq. {equation} of the paper" if equation[:1].isdigit() else ("–" if equation == "-" else equation)
    )


def _value(q: Parameter, value: float | None) -> str:
    return "required" if value is None else quantity(value, q.unit)


def _bounds(q: Parameter) -> str:
    return " to ".join(quantity(b, q.unit) if abs(b) < 1e300 else "∞" for b in q.bounds)


def _unit(unit: str) -> str:
    return "–" if unit == "1" else unit.replace("**", "^")


def _cell(text: str) -> str:
    return text.replace("|", "\\|").replace("<", "&lt;").replace("*", "\\*").replace("_", "\\_")


def _sentence(text: str) -> str:
    text = _cell(text)
    return f"{text[:1].upper()}{text[1:]}." if text else ""
