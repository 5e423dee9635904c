"""``hil init``: a bench file to start from."""

from pathlib import Path
from typing import Annotated, Any

import typer

from hil.cli.options import Json, Link, Replace

FromBoard = Annotated[bool, typer.Option("--from-board", help="Ask the board at --link for what it declares.")]
Like = Annotated[
    str | None,
    typer.Option("--like", help="Bench file or example that fills in what the board does not say."),
]
Target = Annotated[
    Path | None,
    typer.Option("--out", "-o", help="File to write.  [default: my.bench.toml, or observer.py, controller.py]"),
]
PluginKind = Annotated[
    str | None,
    typer.Option("--plugin", help="Write a plug-in that runs as it is: observer or controller; in C with -o NAME.c."),
]
Device = Annotated[str | None, typer.Option("--name", help="Name of the device.  [default: that of the file]")]
Mass = Annotated[float | None, typer.Option("--mass", help="Proof mass, kg.")]
Resonance = Annotated[float | None, typer.Option("--resonance", help="Mean of the two resonances, Hz.")]
Split = Annotated[float | None, typer.Option("--split", help="One resonance less the other, Hz.")]
Azimuth = Annotated[
    float | None, typer.Option("--azimuth", help="Direction from x of the axis of the first resonance, degrees.")
]
Quality = Annotated[float | None, typer.Option("--q", help="Quality factor at the mean resonance.")]
Amplitude = Annotated[float | None, typer.Option("--amplitude", help="Nominal amplitude of the vibration, m.")]
SampleRate = Annotated[float | None, typer.Option("--sample-rate", help="Rate of the sense samples, Hz.")]
SenseGain = Annotated[float | None, typer.Option("--sense-gain", help="Sense output per displacement, V/m, signed.")]
Noise = Annotated[float | None, typer.Option("--noise", help="Noise of one sample, V rms.")]
FullScale = Annotated[float | None, typer.Option("--full-scale", help="Largest drive, m/s² (force per mass).")]


def init(
    from_board: FromBoard = False,
    link: Link = None,
    like: Like = None,
    device: Device = None,
    mass: Mass = None,
    resonance: Resonance = None,
    split: Split = None,
    azimuth: Azimuth = None,
    q: Quality = None,
    amplitude: Amplitude = None,
    sample_rate: SampleRate = None,
    sense_gain: SenseGain = None,
    noise: Noise = None,
    full_scale: FullScale = None,
    plugin: PluginKind = None,
    out: Target = None,
    replace: Replace = False,
    json: Json = False,
) -> None:
    """Write a bench file to start from, and show what follows from it.

    It has every key with its meaning. --from-board reads converters, sample rate and delay from the board. Mass,
    resonance, Q, amplitude and sense gain come from the data sheet. Give them as options, take them from another
    bench file with --like, or fill in what is marked REQUIRED; a unit and an example are given there.

    Examples:

    \b
      hil init -o my.bench.toml
      hil init --resonance 15000 --q 5000 --split 10 --mass 1e-8
      hil init --from-board --link serial:/dev/ttyACM0
      hil init --from-board --link pty:s-slow --like s-slow
      hil init --plugin observer
      hil init --plugin controller -o mine.c
    """
    from hil.bench import Bench, load_bench
    from hil.bench.examples import find
    from hil.bench.template import IN_MPS2, missing, put_in, template, values_of
    from hil.cli.show import echo_figures, print_echo, print_json, say
    from hil.errors import InputError
    from hil.records.atomic import write_text
    from hil.records.kind import fresh, named_by
    from hil.toml.reading import parse_table, table_of

    if plugin is not None:
        _write_plugin(plugin, out, replace=replace, as_json=json)
        return
    out = Path("my.bench.toml") if out is None else out
    if from_board != (link is not None):
        raise InputError("--from-board and --link belong together; give both or neither")
    fresh(out, replace=replace)
    known = {} if like is None else values_of(load_bench(find("bench", like)))
    heading = "A bench file to be filled in."
    identity: dict[str, Any] | None = None
    if link is not None:
        from hil.boards.emulation import located
        from hil.boards.identity import from_identity

        heading, told, identity = from_identity(located(link))
        known = put_in(known, told | {"link": {"url": link}})
    given: dict[str, dict[str, Any]] = {
        "device": {
            "name": device, "mass_kg": mass, "resonance_Hz": resonance, "split_Hz": split, "azimuth_deg": azimuth,
            "q": q, "amplitude_m": amplitude, "sample_rate_Hz": sample_rate,
        },
        "device.sense": {"gain_V_per_m": sense_gain, "noise_V": noise},
        "device.drive": {} if full_scale is None else {"full_scale": full_scale, **IN_MPS2},
    }  # fmt: skip
    known = put_in(known, {name: {k: v for k, v in one.items() if v is not None} for name, one in given.items()})
    unnamed = [section for section in ("device", "loop") if "name" not in known.get(section, {})]
    known = put_in(known, {section: {"name": named_by(out)} for section in unnamed})
    open_keys, text = missing(known), template(known, heading)
    bench = None if open_keys else parse_table(table_of(text.encode(), str(out)), Bench, str(out))
    write_text(out, text)
    if json:
        echo = {} if bench is None else echo_figures(bench, identity)
        print_json({"bench": str(out), "missing": open_keys, **echo})
        return
    say(f"{out}: written" + (f"; still to be filled in: {', '.join(open_keys)}" if open_keys else ""))
    if bench is not None:
        print_echo(bench, identity)


def _write_plugin(kind: str, out: Path | None, *, replace: bool, as_json: bool) -> None:
    """The template of a plug-in."""
    from hil.cli.show import print_json, say
    from hil.errors import InputError
    from hil.plugins.finding import Kind, write_template
    from hil.records.kind import fresh

    kinds: dict[str, Kind] = {"observer": "observer", "controller": "controller"}
    if kind not in kinds:
        raise InputError(f"--plugin {kind}: observer or controller")
    target = Path(f"{kind}.py") if out is None else out
    fresh(target, replace=replace)
    written, name = write_template(kinds[kind], target)
    if as_json:
        print_json({"written": [str(path) for path in written], "plugin": name})
        return
    say(f"{', '.join(map(str, written))}: written")
    if target.suffix == ".c":
        say(f"  next: cc -O2 -shared -fPIC -o {target.with_suffix('.so')} {target} -lm")
    say(f'  in the bench file: [{kind}] plugin = "{name}"')
