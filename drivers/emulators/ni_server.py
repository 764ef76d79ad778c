"""An emulated board behind NI's gRPC protocol: a server for the unchanged `nidaqmx` package, in
this or another program.
"""

from __future__ import annotations

import re
import threading
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from functools import partial
from typing import Any

import grpc
import numpy as np
from google.protobuf.message import Message
from nidaqmx._stubs import nidaqmx_pb2

from drivers.emulators.board import PRODUCT, SERIAL_NUMBER, Board, BoardTask, NiError
from drivers.sim.world import World

SERVICE = nidaqmx_pb2.DESCRIPTOR.services_by_name["NiDAQmx"]
KINDS = {"ai": 10100, "ci": 10131, "co": 10132, "do": 10153}
# attribute -> its value, given the board and, where the call names one, the task
ATTRIBUTES: dict[int, Callable[[Board, Any], Any]] = {
    0x1272: lambda board, task: 25,  # version of NI-DAQmx: major, minor, update
    0x1923: lambda board, task: 0,
    0x2F22: lambda board, task: 0,
    0x193B: lambda board, task: board.device,
    0x631: lambda board, task: PRODUCT,
    0x632: lambda board, task: SERIAL_NUMBER,
    0x22CA: lambda board, task: True,  # it is simulated
    0x1276: lambda board, task: task.name,
    0x1273: lambda board, task: ", ".join(f"{board.device}/{c}" for c in task.channels),
    0x187F: lambda board, task: KINDS[task.kind],
    0x217F: lambda board, task: 1,  # lines in a channel
    0x1344: lambda board, task: task.rate_hz,
    0x186C: lambda board, task: task.buffer,
    0x192A: lambda board, task: board.total(task),
}
FALLING = 10171
TEXTS = {
    -200279: "The application is not able to keep up with the hardware acquisition.",
    -200284: "Some or all of the samples requested have not yet been acquired.",
}


class NiServer:
    """A gRPC server with one emulated board.

    Parameters
    ----------
    world : World
    board : optional
        Further arguments of `drivers.emulators.board.Board`.
    """

    def __init__(self, world: World, **board: Any) -> None:
        self._world, self._over = world, threading.Event()
        self.board = Board(world, when_gone=self.kill, **board)
        self._calls = _Calls(self.board)
        self._pool = ThreadPoolExecutor(16, "emulated NI server")
        self._server = grpc.server(self._pool, options=[("grpc.so_reuseport", 0)])
        handlers = {method.name: self._handler(method) for method in SERVICE.methods}
        self._server.add_generic_rpc_handlers(
            (grpc.method_handlers_generic_handler(SERVICE.full_name, handlers),)
        )
        self.address = f"127.0.0.1:{self._bind('127.0.0.1:0')}"
        self._server.start()

    def _bind(self, where: str) -> int:
        """Listen, at a port that is free."""
        return int(self._server.add_insecure_port(where))

    def kill(self) -> None:
        """Stop at once, also in the middle of an answer."""
        self._over.set()
        self._server.stop(None)

    def close(self) -> None:
        """End calls, board and threads."""
        self._over.set()
        stopped = self._server.stop(None)
        self.board.unplug()
        self.board.close()
        stopped.wait()
        self._pool.shutdown()

    def _hold(self) -> None:
        """Keep a call for as long as the faults of the world say."""
        faults, now = self._world.faults, self._world.now
        if faults.since("silent-server", now):
            self._over.wait()
        elif slow := faults.since("slow-server", now):
            self._over.wait(slow.amount * 1e-3)

    def _handler(self, method: Any) -> grpc.RpcMethodHandler:
        reply = getattr(nidaqmx_pb2, method.output_type.name)
        do = getattr(self._calls, method.name, None)

        def answer(request: Message, context: grpc.ServicerContext) -> Message:
            try:
                self._hold()
                self.board.check()
                if do is None:
                    raise NiError(
                        -200452, f"The emulated board does not know the call {method.name}."
                    )
                return reply(**(do(request) or {}))
            except NiError as error:
                context.set_trailing_metadata(
                    (("ni-error", str(error.code)), ("ni-samps-per-chan-read", "0"))
                )
                context.abort(grpc.StatusCode.UNKNOWN, str(error))

        request = getattr(nidaqmx_pb2, method.input_type.name)
        return grpc.unary_unary_rpc_method_handler(
            answer, request.FromString, reply.SerializeToString
        )


class _Calls:
    """NI's calls by their names: each acts on the board and gives the fields of its answer."""

    def __init__(self, board: Board) -> None:
        self._board = board
        self._tasks: dict[str, BoardTask] = {}
        self._made = 0

    def _task(self, request: Any) -> BoardTask:
        try:
            return self._tasks[request.task.name]
        except KeyError:
            raise NiError(-200088, "Task specified is invalid or does not exist.") from None

    # ------------------------------------------------------------------ attributes

    def __getattr__(self, name: str) -> Callable[[Any], dict[str, Any]]:
        if re.fullmatch("Get[A-Za-z]+Attribute[A-Za-z0-9]+", name) is None:
            raise AttributeError(name)
        return partial(self._attribute, "value_raw" if name.endswith("eInt32") else "value")

    def _attribute(self, field: str, r: Any) -> dict[str, Any]:
        if hasattr(r, "device_name"):
            self._board.channel(f"{r.device_name}/ai0")
        task = self._task(r) if hasattr(r, "task") else None
        return {field: _known(ATTRIBUTES, r)(self._board, task)}

    def GetErrorString(self, r: Any) -> dict[str, Any]:
        return {"error_string": TEXTS.get(r.error_code, f"Error {r.error_code}")}

    # ------------------------------------------------------------------ tasks

    def CreateTask(self, r: Any) -> dict[str, Any]:
        self._made += 1
        name = r.session_name or f"_unnamedTask<{self._made}>"
        if name in self._tasks:
            raise NiError(
                -200089, f"Task name conflicts with an existing task name.\nTask Name: {name}"
            )
        self._tasks[name] = BoardTask(name)
        return {"task": {"name": name}, "new_session_initialized": True}

    def StartTask(self, r: Any) -> None:
        self._board.start(self._task(r))

    def StopTask(self, r: Any) -> None:
        self._board.stop(self._task(r))

    def ClearTask(self, r: Any) -> None:
        self._board.clear(self._task(r))
        del self._tasks[r.task.name]

    def TaskControl(self, r: Any) -> None:
        if r.action_raw in (2, 3, 4):  # verify, commit, reserve
            self._board.claim(self._task(r))

    # ------------------------------------------------------------------ channels, clocks, triggers

    def CreateAIVoltageChan(self, r: Any) -> None:
        if not r.max_val == -r.min_val <= 10:
            raise NiError(
                -200077,
                f"Requested value is not a supported value for this property: {r.min_val:g} V to"
                f" {r.max_val:g} V.",
            )
        self._board.add(self._task(r), "ai", r.physical_channel)
        self._task(r).limits_v.append(r.max_val)

    def CreateCICountEdgesChan(self, r: Any) -> None:
        self._board.add(self._task(r), "ci", r.counter)
        self._task(r).counts_falling = FALLING in (r.edge, r.edge_raw)

    def CreateCOPulseChanTicks(self, r: Any) -> None:
        self._board.add(self._task(r), "co", r.counter)
        if r.source_terminal == f"/{self._board.device}/20MHzTimebase":
            self._task(r).ticks = r.initial_delay, r.low_ticks + r.high_ticks

    def CreateDOChan(self, r: Any) -> None:
        self._board.add(self._task(r), "do", r.lines)

    def SetChanAttributeString(self, r: Any) -> None:
        _known({0x18C7: True, 0x18E1: True}, r)  # source of the edges, output of the pulses
        self._task(r).terminal = r.value

    def CfgSampClkTiming(self, r: Any) -> None:
        self._board.set_clock(self._task(r), r.rate, r.source, r.samps_per_chan)

    def CfgImplicitTiming(self, r: Any) -> None:
        self._task(r)

    def CfgDigEdgeStartTrig(self, r: Any) -> None:
        self._task(r).start_trigger = r.trigger_source

    def WriteDigitalLines(self, r: Any) -> dict[str, Any]:
        self._task(r).pattern = np.frombuffer(r.write_array, np.uint8).astype(bool)
        if r.auto_start:
            self._board.start(self._task(r))
        return {"samps_per_chan_written": r.num_samps_per_chan}

    # ------------------------------------------------------------------ samples

    def SetBufferAttributeUInt32(self, r: Any) -> None:
        _known({0x186C: True}, r)
        self._task(r).buffer = r.value

    def SetReadAttributeInt32(self, r: Any) -> None:
        value = r.value_raw or r.value
        name = _known({0x190A: "relative_to", 0x190B: "offset", 0x1211: "overwrites"}, r)
        setattr(self._task(r), name, value == 10252 if name == "overwrites" else value)

    def ReadAnalogF64(self, r: Any) -> dict[str, Any]:
        values = self._board.read(self._task(r), r.num_samps_per_chan, r.timeout)
        array = np.zeros(r.array_size_in_samps, values.dtype)
        # a short read fills the beginning, channel after channel
        array[: values.size] = values.ravel()
        came = values.shape[1]
        return {
            "status": 0 if came == r.num_samps_per_chan else -200284,
            "read_array": array.tolist(),
            "samps_per_chan_read": came,
        }

    ReadCounterU32Ex = ReadAnalogF64


def _known(values: dict[int, Any], request: Any) -> Any:
    if request.attribute_raw not in values:
        raise NiError(
            -200452,
            f"The emulated board does not have attribute {request.attribute_raw:#x} of"
            f" {type(request).__name__}.",
        )
    return values[request.attribute_raw]
