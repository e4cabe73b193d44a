"""What a stream needs of a controller: calls of the library, one coordinate system and FIFO, channels and axes."""

from __future__ import annotations

import numpy as np
from msgspec import Struct

from gusjob.config.machine import Machine
from gusjob.controllers.gus.calls import BUFFERED, Buffered, Stream, Value
from gusjob.controllers.gus.remainder import CRD_CALLS
from gusjob.diagnostics import rules
from gusjob.diagnostics.model import Diagnostic, Span
from gusjob.i18n.phrases import Phrase

RUN_CALLS = (
    "GT_Open",
    "GT_Close",
    "GT_ClrSts",
    "GT_AxisOn",
    "GT_AxisOff",
    "GT_SetHSIOOpt",
    "GT_LaserPrfCmd",
    "GT_SetCrdPrm",
    "GT_CrdClear",
    "GT_CrdSpace",
    "GT_CrdStart",
    "GT_CrdStatus",
    "GT_GetCrdPos",
    "GT_Stop",
    "GT_LnXY",
)
"""The calls that every run needs, in addition to those of its job."""
LASER_CALLS = ("GT_LaserPowerMode", "GT_BufLaserOn", "GT_BufLaserOff", "GT_BufLaserPrfCmd")
"""The calls that every job with a laser needs, in addition to those of every run."""


class Outputs(Struct, frozen=True, kw_only=True):
    """The laser channels, coordinate systems and axes that a job uses.

    A shutdown turns off all channels and systems, since an earlier program may have left any of them on; for those that
    the job does not use, the controller may answer that it has none.
    """

    channels: tuple[int, ...]
    crds: tuple[int, ...]
    axes: tuple[int, ...]


def needed_calls(stream: Stream, machine: Machine) -> set[str]:
    """Return every call that a run of a stream on a machine can make."""
    names = {*RUN_CALLS, *(call.name for call in stream.calls)}
    names |= {BUFFERED[Buffered(kind)].name for kind in np.unique(stream.buffered.kind).tolist()}
    # A resumed run rebuilds its state with buffered calls, and an arc with one about its centre.
    names |= {"GT_BufLaserOn", "GT_BufLaserPrfCmd"} if "GT_BufLaserOn" in names or "GT_LaserPrfCmd" in names else set()
    names |= {"GT_ArcXYC"} if "GT_ArcXYR" in names else set()
    names |= {"GT_LoadConfig"} if machine.controller.configuration else set()
    return names | ({"GT_GetDi"} if machine.controller.interlock else set())


_NOT_IN_RUN = ("GT_Reset", "GT_Stop")
"""Calls of a program that controls its run itself: a run has its own stop, and needs the state that it set up."""


def check_stream(stream: Stream) -> list[Diagnostic]:
    """Refuse a stream that a run on hardware can't send."""
    refused = [
        Diagnostic(rule=rules.NOT_IN_RUN, span=Span(line=call.line), fields={"call": call.name})
        for call in stream.calls
        if call.name in _NOT_IN_RUN
    ]
    return [*check_single_fifo(stream), *refused[:1]]


def check_single_fifo(stream: Stream) -> list[Diagnostic]:
    """Refuse a stream that fills more than one FIFO: the order in which they run is not known."""
    calls = stream.buffered
    queue = calls.crd.astype(np.int64) * 2 + calls.fifo
    if not len(queue) or (queue == queue[0]).all():
        return []
    row = int(np.argmax(queue != queue[0]))
    names = [
        Phrase("GT_ calls of coordinate system {crd}, FIFO {fifo}", crd=int(calls.crd[i]), fifo=int(calls.fifo[i]))
        for i in (row, 0)
    ]
    fields = {"what": names[0], "first": names[1]}
    return [Diagnostic(rule=rules.SEVERAL_SYSTEMS, span=Span(line=int(calls.line[row])), fields=fields)]


def outputs_of(stream: Stream) -> Outputs:
    """Return what a stream may leave on."""
    calls = stream.buffered
    channels = {int(c) for c in np.unique(calls.channel[calls.kind >= Buffered.ON])}
    for call in stream.calls:
        if call.name not in (*CRD_CALLS, "GT_SetAxisMode"):
            channels.add(int(number(call.args[-1])))
    crds = {int(c) for c in np.unique(calls.crd)} or {1}
    axes = {axis for call in stream.calls if call.name == "GT_SetCrdPrm" for axis in _axes(call.args[1])} or {1, 2}
    return Outputs(channels=tuple(sorted(channels)), crds=tuple(sorted(crds)), axes=tuple(sorted(axes)))


def number(value: Value) -> float:
    """Narrow an argument that is a number."""
    assert isinstance(value, float)
    return value


def _axes(parameters: Value) -> list[int]:
    """Return the axes of a coordinate system: those whose profile names a dimension (sister)."""
    profile = parameters[1] if isinstance(parameters, tuple) else ()
    assert isinstance(profile, tuple)
    return [axis for axis, dimension in enumerate(profile, 1) if dimension]
