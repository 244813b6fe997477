"""`tsplinejax mra`: a height map as bands from coarse to fine."""

import argparse
from typing import TYPE_CHECKING

import numpy as np

from ..data import HeightMap
from ..io._files import written_whole
from ..plot import plot_bands
from ._arguments import add_command, add_data_options, add_input, add_output, add_plot, add_tolerances, counts
from ._files import checked_output, checked_picture, read_map, write_picture
from ._outcome import MET, STOPPED_EARLIER, Outcome, described, pair, quantity, table, written

if TYPE_CHECKING:
    from ..multiresolution import Band, Multiresolution

_ARRAYS = (".npz",)
_OPTIONS = ("levels", "tolerance", "relative_tolerance", "lattice")


def add(subparsers: argparse._SubParsersAction) -> None:
    """Add the command to the parser."""
    parser = add_command(
        subparsers,
        "mra",
        "take a height map apart into bands from coarse to fine",
        "tsplinejax mra map.x3p -o bands.npz --levels 5 --plot bands.png",
        run,
    )
    add_input(parser)
    add_output(
        parser,
        "arrays to write: bands (k, rows, columns), which add up to fitted, remainder, wavelengths (k, 2)",
        "BANDS.npz",
    )
    group = parser.add_argument_group("bands (default: uniform lattices, each twice as fine as the one before)")
    group.add_argument("--levels", metavar="N", type=int, help="how many (default: down to elements of four pixels)")
    add_tolerances(group, "adaptive meshes, refined to this largest remainder: 5nm, 0.8um")
    group.add_argument(
        "--lattice",
        metavar="MxN",
        type=counts,
        help="elements of the first band, M along x (default 3 on the shorter side)",
    )
    add_plot(parser, "draw all bands")
    add_data_options(parser)


def run(arguments: argparse.Namespace) -> Outcome:
    """Read, take apart, write."""
    from ..multiresolution import mra

    inputs = (arguments.input, arguments.mask)
    target = checked_output(arguments.output, _ARRAYS, *inputs)
    picture = checked_picture(arguments.plot, *inputs)
    data = read_map(arguments, "bands are of")
    analysis = mra(data, **{name: getattr(arguments, name) for name in _OPTIONS})
    with written_whole(target) as stream:
        np.savez(stream, allow_pickle=False, **arrays(analysis))
    write_picture(picture, lambda: plot_bands(analysis))
    report = {**written(output=target, plot=picture), **analysis.report}
    options = {name: getattr(arguments, name) for name in _OPTIONS}
    report["provenance"] = {**report["provenance"], "options": options, "stop": report["stop"]}
    report["warnings"] = [*data.provenance.get("notes", ()), *report["warnings"]]
    files = [str(path) for path in (target, picture) if path is not None]
    return Outcome(report, _lines(data, analysis, files), MET if analysis.converged else STOPPED_EARLIER)


def arrays(analysis: "Multiresolution") -> dict[str, np.ndarray]:
    """What the output holds, by name."""
    return {
        "bands": analysis.heights,
        "fitted": analysis.fitted.heights,
        "remainder": analysis.remainder.heights,
        "wavelengths": np.array([(band.shortest, band.longest) for band in analysis.bands]),
    }


def _lines(data: HeightMap, analysis: "Multiresolution", files: list[str]) -> tuple[str, ...]:
    unit = analysis.unit
    return table(
        [
            ("data", described(data)),
            *(
                (f"band {k}", f"Sq {quantity(band.sq, unit)}, waves {_waves(band, unit)}")
                for k, band in enumerate(analysis.bands)
            ),
            ("remainder", f"Sq {quantity(analysis.sq_remainder, unit)}, largest {quantity(analysis.max_error, unit)}"),
            ("time", f"{analysis.seconds:.1f} s"),
            ("written", ", ".join(files)),
        ]
    )


def _waves(band: "Band", unit: str | None) -> str:
    """A band's wavelengths."""
    if np.isinf(band.longest):
        return f"above {quantity(band.shortest, unit)}"
    return f"of {pair(band.shortest, band.longest, unit).replace(' × ', ' to ')}"
