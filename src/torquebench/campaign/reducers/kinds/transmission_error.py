"""Transmission error: both angles over full output revolutions."""

from __future__ import annotations

import numpy as np

from torquebench.bench.roles import SIDES, Side
from torquebench.campaign.reducers.uncertainty import Bench, resolution_rad, temperature_remarks
from torquebench.campaign.reducers.work import Evaluated, ReducerTestWork
from torquebench.figures import (
    COLOURS,
    blank_figure,
    legend_above,
    new_figure,
    styled,
    svg_text,
)
from torquebench.message import Message
from torquebench.procedures.reducers.turning import (
    TransmissionRecording,
    TransmissionSettings,
    transmission_error,
)
from torquebench.reducers import (
    AngleUncertainty,
    ReducerDescription,
    SwingsResult,
    TransmissionErrorResult,
    evaluate_transmission_error,
)
from torquebench.units import ARCMIN, ARCSEC, DEG_PER_RAD, TURN


def _encoder_rad(bench: Bench, side: Side, certified_rad: float | None) -> float:
    """Return an encoder's standard uncertainty, from its resolution and its error over a turn.

    The stated accuracy is the amplitude of a sine over one turn, hence divided by √2; with a
    certificate's correction, only the uncertainty of that remains.
    """
    if certified_rad is not None:
        return float(np.hypot(resolution_rad(bench, side) / np.sqrt(12.0), certified_rad))
    accuracy = (bench.description.needed_encoder(side).accuracy_arcsec or 0.0) * ARCSEC
    return float(np.hypot(resolution_rad(bench, side) / np.sqrt(12.0), accuracy / np.sqrt(2.0)))


def _evaluate(
    bench: Bench, reducer: ReducerDescription, turning: TransmissionRecording
) -> Evaluated:
    """Evaluate the transmission error of both directions."""
    certified = turning.certified_rad
    uncertainty = AngleUncertainty(
        *(_encoder_rad(bench, side, certified.get(side)) for side in ("output", "input"))
    )
    result = evaluate_transmission_error(
        np.concatenate([direction.input_angle_rad for direction in turning.directions]),
        np.concatenate([direction.output_angle_rad for direction in turning.directions]),
        reducer.signed_ratio,
        time_s=np.concatenate([direction.time_s for direction in turning.directions]),
        highest_order=reducer.highest_error_order,
        uncertainty=uncertainty,
    )
    remarks = [
        Message(
            "U contains only the resolution of the {side} encoder: its accuracy isn't described",
            side,
        )
        for side in SIDES
        if bench.description.needed_encoder(side).accuracy_arcsec is None and side not in certified
    ]
    remarks += [
        Message("the {side} encoder is corrected by its certificate", side) for side in certified
    ]
    return Evaluated(result, (*remarks, *temperature_remarks(turning.temperature_c)))


def _over_revolution(result: TransmissionErrorResult) -> str:
    """Draw the error over one output revolution in both directions, and its orders below."""
    with styled():
        panels = len(result.directions) + 1
        figure, axes = new_figure(1.75 * panels + 0.6, panels)
        lower = axes[-1]
        shift = 0.004 * result.highest_order
        for number, (upper, each) in enumerate(zip(axes, result.directions, strict=False)):
            colour = COLOURS[number]
            upper.plot(each.angle_rad * DEG_PER_RAD, each.error_arcsec, color=colour, lw=0.7)
            upper.set_title(
                f"{each.direction}, {each.peak_to_peak.value:.1f} arcsec peak to peak",
                loc="left",
                fontsize=9,
                color=colour,
            )
            upper.set_xlim(0.0, 360.0)
            upper.set_xticks(np.arange(0.0, 361.0, 45.0))
            upper.set_ylabel("error in arcsec")
            lower.vlines(
                each.order + number * shift,
                0.0,
                each.amplitude_arcsec,
                color=colour,
                lw=1.3,
                label=each.direction,
            )
        axes[-2].set_xlabel("output angle in degrees")
        taken: list[float] = []
        for order in result.directions[0].orders:
            if any(abs(order.order - other) < 0.02 * result.highest_order for other in taken):
                continue
            if order.amplitude.value > 2.0 * order.amplitude.expanded_uncertainty():
                taken.append(order.order)
                lower.annotate(
                    f"{order.order:g}",
                    (order.order, order.amplitude.value),
                    xytext=(4, 1),
                    textcoords="offset points",
                    fontsize=8,
                )
        lower.set_xlim(-0.01 * result.highest_order, 1.05 * result.highest_order)
        highest = max(float(np.max(direction.amplitude_arcsec)) for direction in result.directions)
        lower.set_ylim(0.0, 1.15 * highest)
        turn = abs(result.ratio)
        lower.set_xlabel(f"order per output revolution; once a turn of the input: {turn:g}")
        lower.set_ylabel("amplitude in arcsec")
        return svg_text(figure)


def _polar(result: TransmissionErrorResult) -> str:
    """Draw the error over one output revolution as a polar plot, with a circle at zero."""
    with styled():
        figure = blank_figure(4.4)
        axes = figure.subplots(1, 1, subplot_kw={"projection": "polar"})
        worst = max(
            float(np.max(np.abs(direction.error_arcsec))) for direction in result.directions
        )
        for number, each in enumerate(result.directions):
            closed = np.append(each.error_arcsec, each.error_arcsec[:1])
            angle = np.append(each.angle_rad, TURN)
            axes.plot(angle, closed, color=COLOURS[number], lw=0.7, label=each.direction)
        axes.plot(np.linspace(0, TURN, 361), np.zeros(361), color="#3C4148", lw=0.8)
        axes.set_ylim(-2.2 * worst, 1.15 * worst)
        axes.set_rlabel_position(22.5)  # type: ignore[attr-defined]  # polar axes only
        step = float(f"{worst / 2.0:.0e}") or 1.0
        axes.set_yticks(
            [-2 * step, 0.0, 2 * step], labels=[f"{v:g}″" for v in (-2 * step, 0, 2 * step)]
        )
        axes.legend(loc="center left", bbox_to_anchor=(1.08, 0.5), frameon=False)
        return svg_text(figure)


def _over_strokes(result: SwingsResult) -> str:
    """Draw the error of each stroke over the angle, with the gap between both directions."""
    middle = float(np.mean(np.concatenate([stroke.error_rad for stroke in result.swings])))
    with styled():
        figure, (axes,) = new_figure(3.2)
        for forward, colour in ((True, COLOURS[0]), (False, COLOURS[1])):
            label: str | None = "forward" if forward else "backward"
            for stroke in result.swings:
                if stroke.forward == forward:
                    angle = stroke.angle_rad * DEG_PER_RAD
                    error = (stroke.error_rad - middle) / ARCMIN
                    axes.plot(angle, error, color=colour, lw=0.8, label=label)
                    label = None
        axes.set_xlabel("output angle in degrees")
        axes.set_ylabel("error in arcmin")
        legend_above(axes)
        return svg_text(figure)


def _figures(result: TransmissionErrorResult | SwingsResult) -> tuple[tuple[str, str], ...]:
    """Return the diagrams over strokes, or over the revolution, with captions."""
    if isinstance(result, SwingsResult):
        strokes = (
            "Output angle minus input angle divided by the ratio, mean removed, stroke by stroke."
        )
        return ((_over_strokes(result), strokes),)
    caption = Message(
        "Output angle minus input angle divided by the ratio over one output revolution, mean "
        "removed, orders up to {order:g}; below its orders.",
        result.highest_order,
    )
    polar = "The same as a polar plot: the dark circle is an error of 0."
    return ((_over_revolution(result), caption), (_polar(result), polar))


WORK = ReducerTestWork(
    settings=TransmissionSettings(),
    short=TransmissionSettings(output_rpm=4.0),
    recording=TransmissionRecording,
    plan=transmission_error,
    evaluate=_evaluate,
    figures=_figures,
)
