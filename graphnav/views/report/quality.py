"""Figures of the solution's quality: calibration with bands, residual histograms."""

from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from graphnav.result import palette
from graphnav.result.result_directory import Curve, Results, columns
from graphnav.views.recording.curves import label, title
from graphnav.views.report import svg
from graphnav.views.report.drive import SINCE_START, limits

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from pandas import DataFrame

Array = NDArray[np.float64]

HISTOGRAM_SIGMAS = 6.0


def unit(curve: Curve) -> str:
    """The unit in brackets, or nothing for a pure number."""
    return "" if curve.unit in ("", "1") else f"[{curve.unit}]"


def curves(results: Results) -> str | None:
    """Quantities that change over time, one panel a component; None when all are constant."""
    moving = [c for c in results.calibration.values() if not c.constant and len(c.time) > 1]
    rows = [(c, k) for c in moving for k in range(len(c.components))]
    if not rows:
        return None
    figure, axes = svg.figure([0.95] * len(rows), gap=0.32)
    for panel, (curve, k) in zip(axes, rows, strict=True):
        at = curve.time - results.clock_start
        component = curve.components[k]
        colour = palette.MOTION.get(component, palette.AXES[k % 3])
        svg.band(panel, at, curve.value[:, k], curve.sd[:, k], colour)
        if np.isfinite(curve.prior[k]):
            panel.axhline(curve.prior[k], color=svg.FAINT, lw=0.8, ls=":")
        name = title(curve.name)
        if len(curve.components) > 1:
            name += f", {label(component)}"
        panel.set_title(f"{name} {unit(curve)}{'' if curve.observable[k] else ' (not observable)'}")
    svg.share_time(axes, limits(results), SINCE_START)
    return svg.text(figure, "Calibration over time")


def factors(results: Results) -> str | None:
    """Constants that differ by motion state: estimate and prior, 3 sigma each; None without any."""
    shown = [c for c in results.calibration.values() if c.constant and _of_states(c)]
    if not shown:
        return None
    figure, axes = svg.figure([0.24 * len(c.components) + 0.2 for c in shown], left=2.6, gap=0.6)
    for panel, curve in zip(axes, shown, strict=True):
        _forest(panel, curve)
        panel.set_title(f"{title(curve.name)} {unit(curve)}")
    axes[0].legend(loc="lower right", bbox_to_anchor=(1.0, 1.0), ncols=2)
    return svg.text(figure, "Factors by motion state")


def _of_states(curve: Curve) -> bool:
    return any(component in palette.MOTION for component in curve.components)


def _forest(panel: "Axes", curve: Curve) -> None:
    rows = np.arange(len(curve.components))
    prior: dict[str, Any] = {"color": svg.FAINT, "fmt": "none", "elinewidth": 1.0, "capsize": 2.5}
    if np.isfinite(curve.prior_sd).any():
        panel.errorbar(
            curve.prior, rows + 0.2, xerr=3 * curve.prior_sd, label="prior ± 3σ", **prior
        )
    for k, component in enumerate(curve.components):
        drawn: dict[str, Any] = {
            "color": palette.motion(component),
            "fmt": "o",
            "ms": 4,
            "elinewidth": 2.0,
        }
        name = "estimate ± 3σ" if k == 0 else None
        panel.errorbar(curve.value[0, k], k - 0.1, xerr=3 * curve.sd[0, k], label=name, **drawn)
    names = [
        label(c) + ("" if seen else " (not observable)")
        for c, seen in zip(curve.components, curve.observable, strict=True)
    ]
    panel.set_yticks(rows, names)
    panel.set_ylim(len(rows) - 0.5, -0.5)


def residuals(results: Results) -> str | None:
    """Whitened residuals of each kind against the normal density; None without residuals."""
    if results.residuals is None:
        return None
    kinds = [(str(kind), table) for kind, table in results.residuals.groupby("kind", sort=True)]
    across = min(3, len(kinds))
    down = -(-len(kinds) // across)
    figure, axes = svg.figure([1.6] * down, across, gap=0.95, top=0.5)
    edges = np.linspace(-HISTOGRAM_SIGMAS, HISTOGRAM_SIGMAS, 49)
    normal = np.exp(-(edges**2) / 2) / np.sqrt(2 * np.pi)
    for k, (kind, table) in enumerate(kinds):
        value = columns(table, "value")[:, 0]
        inside = np.clip(value[np.isfinite(value)], edges[0], edges[-1])
        density, _ = np.histogram(inside, edges, density=True)
        # one outline, no minor ticks, plain labels: many times faster than matplotlib's defaults
        axes[k].set_yscale("log", subs=[])
        axes[k].stairs(density, edges, fill=True, baseline=1e-6, color=palette.AXES[2], alpha=0.75)
        axes[k].plot(edges, normal, color=svg.INK, lw=1.0)
        axes[k].set_yticks([1e-4, 1e-2, 1.0], ["0.0001", "0.01", "1"])
        axes[k].set(ylim=(1e-5, 4.0), xlabel="residual [σ]", xticks=range(-6, 7, 3))
        axes[k].tick_params(labelleft=k % across == 0)
        axes[k].set_title(f"{kind.replace('_', ' ')}\n{_by_axis(table)}")
    for unused in axes[len(kinds) :]:
        unused.set_visible(False)
    axes[0].set_ylabel("density")
    return svg.text(figure, "Histograms of whitened residuals")


def _by_axis(table: "DataFrame") -> str:
    """Count, RMS as the solver saw it (robust weights applied), share turned down."""
    value = columns(table, "value")[:, 0]
    weight = columns(table, "weight")[:, 0] if "weight" in table else np.ones(len(value))
    rms = float(np.sqrt(np.nanmean(np.nan_to_num(weight, nan=1.0) * value**2)))
    return f"{len(value)}, RMS {rms:.2f}, {100 * np.mean(weight < 0.5):.1f} % turned down"
