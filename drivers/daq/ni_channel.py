"""The connection to NI's gRPC device server, on which every call has a deadline: a server that
accepts calls and does not answer them is a fault and not an endless wait.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

OPTIONS = [
    ("grpc.enable_http_proxy", 0),
    ("grpc.max_receive_message_length", -1),  # a second of six channels at 100 kHz has 4.8 MB
    # a server that is frozen, or whose cable is cut, is found between the calls, too
    ("grpc.keepalive_time_ms", 2000),
    ("grpc.keepalive_timeout_ms", 2000),
    ("grpc.http2.ping_timeout_ms", 2000),
    ("grpc.min_reconnect_backoff_ms", 3000),  # also how long a first connection may take
]

FIRST_TIMES = 5  # as long has the first call, which lets the server load NI-DAQmx


def connect(server: str, certificate: bytes | None, answer_s: float) -> tuple[Any, Any]:
    """The connection to ``host:port``, to be closed, and the channel that makes calls on it.

    Parameters
    ----------
    certificate : bytes or None
        What vouches for the server (PEM); None: an unencrypted connection.
    answer_s : float
        Time that each call has, and the first one `FIRST_TIMES` over.
    """
    import grpc

    class Deadline(grpc.UnaryUnaryClientInterceptor):  # type: ignore[misc]
        times = FIRST_TIMES

        def intercept_unary_unary(
            self, continuation: Callable[..., Any], client_call_details: Any, request: Any
        ) -> Any:
            timeout_s, self.times = self.times * answer_s, 1
            return continuation(client_call_details._replace(timeout=timeout_s), request)

    if certificate is None:
        channel = grpc.insecure_channel(server, OPTIONS)
    else:
        channel = grpc.secure_channel(server, grpc.ssl_channel_credentials(certificate), OPTIONS)
    return channel, grpc.intercept_channel(channel, Deadline())
