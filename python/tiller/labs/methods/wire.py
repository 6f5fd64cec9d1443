"""Words with the process that has the logs and simulates (tools/identify/laboratory.cpp): blocks of bytes, each behind
its length; what goes there has a letter in front."""
from __future__ import annotations

import json
import socket
import struct
from typing import Any

import numpy as np

from ..problem import Array

LANES = 64  # candidates that are simulated side by side


class Gone(Exception):
    """The other process has ended."""


class Wire:
    def __init__(self, channel: socket.socket) -> None:
        self.channel = channel

    def _receive(self, size: int) -> bytearray:
        block = bytearray(size)
        view, done = memoryview(block), 0
        while done < size:
            count = self.channel.recv_into(view[done:])
            if count == 0:
                raise Gone
            done += count
        return block

    def block(self) -> bytearray:
        return self._receive(struct.unpack("=Q", self._receive(8))[0])

    def numbers(self, shape: tuple[int, ...]) -> Array:
        return np.frombuffer(self._receive(8 * int(np.prod(shape)))).reshape(shape)

    def send(self, kind: str, block: bytes) -> None:
        try:
            self.channel.sendall(kind.encode() + struct.pack("=Q", len(block)) + block)
        except OSError as ended:
            raise Gone from ended

    def send_json(self, kind: str, document: dict[str, Any]) -> None:
        self.send(kind, json.dumps(document, allow_nan=False).encode())
