"""`hexsim trace --list` and `--explain EFFECT`: the library of effects for people."""

from __future__ import annotations

from pathlib import Path

from hexsim.cli.console import output, print_json, text_table


def print_library(json: bool) -> None:
    """The library of effects, each with its balance and signature."""
    from hexsim.hydraulics.advice import advice_of
    from hexsim.hydraulics.effects import library

    rows = [(effect.name, effect.balance, advice_of(effect.name).signature) for effect in library().values()]
    if json:
        names = ("name", "balance", "signature", "check", "mend")
        texts = ((said.check, said.mend) for said in map(advice_of, library()))
        return print_json([dict(zip(names, (*row, *more), strict=True)) for row, more in zip(rows, texts, strict=True)])
    output().print(text_table("Effects", ("effect", "balance", "signature"), rows, last="left"))


def print_explanation(name: str, out: Path | None, json: bool) -> None:
    """One effect: what it is, its signature drawn, typical sizes, what to check, how to mend it; the figure into `out`."""
    from rich.text import Text

    from hexsim.hydraulics.advice import advice_of
    from hexsim.hydraulics.effects import effect_named
    from hexsim.recording.figure_style import png
    from hexsim.tracing.signature import drawn, picture, signature, title_of, unit_of

    effect, said = effect_named(name, "--explain"), advice_of(name)
    found = signature(name) if effect.parameters else None
    place = None
    if out is not None and found is not None:
        out.mkdir(parents=True, exist_ok=True)
        place = out / f"{name}.png"
        place.write_bytes(png(picture(found)))
    sizes = [
        {"name": p.name, "unit": p.unit, "typical": p.typical, "bounds": list(p.bounds)} for p in effect.parameters
    ]
    texts = {
        "effect": effect.name,
        "balance": effect.balance,
        "what": effect.description,
        "source": effect.source,
        "signature": said.signature,
        "check": said.check,
        "mend": said.mend,
    }
    if json:
        return print_json(texts | {"parameters": sizes, "picture": None if place is None else str(place)})
    console = output()
    for key, text in texts.items():
        console.print(Text.assemble((f"{key:<10}", "bold"), text))
    for p in sizes:
        text = f"{p['name']}: typical {p['typical']:g}, from {p['bounds'][0]:g} to {p['bounds'][1]:g}"
        console.print(Text.assemble((f"{'size':<10}", "bold"), text))
    if effect.shown_by:
        console.print(Text.assemble((f"{'shown by':<10}", "bold"), effect.shown_by))
    if found is not None:
        console.print()
        words = f"{title_of(found)} [{unit_of(found)}]: + moving out, o moving in"
        for line in (words, *drawn(found)):
            console.print(Text(line, no_wrap=True, overflow="crop"))
    if place is not None:
        console.print(f"picture   {place}")
