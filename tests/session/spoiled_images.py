"""Images spoiled at random, by a seed: by chance, and headers that claim what is not there, with
their checksums made right again.
"""

from __future__ import annotations

import random
import struct
import zlib
from pathlib import Path

from spoiled import BYTES, bomb

_SIZES = [0, 1, 63, 65, 2**14, 2**15 - 1, 2**16, 2**24, 2**31 - 1, 2**31, 2**32 - 1]
_CHANCE = [name for name in BYTES if name != "forged header"]


def spoil_image(content: bytes, rng: random.Random) -> tuple[str, bytes]:
    """What was done to a PNG or a TIFF, and what is left of it."""
    how = rng.choice(["chance", "claim", "claim", "bomb", "other kind"])
    if how == "chance":
        spoiled = bytearray(content)
        BYTES[rng.choice(_CHANCE)](spoiled, rng)
        return how, bytes(spoiled)
    if how == "other kind":
        return how, rng.choice(
            [
                *(
                    b"",
                    b"\x89PNG\r\n\x1a\n",
                    b"II*\0",
                    b"MM\0*\0\0\0\x08",
                    b"GIF89a\xff\xff\xff\xff",
                ),
                *(
                    b"BM" + rng.randbytes(60),
                    b"#?RADIANCE\n",
                    b"P5 99999 99999 255\n",
                    b"\0" * 4096,
                ),
                b"\xff\xd8\xff\xe0" + rng.randbytes(200),
                b"\0\0\0\x0cjP  \r\n\x87\n" + rng.randbytes(200),
                b"RIFF\xff\xff\xff\x7fWEBPVP8L" + rng.randbytes(60),
                b"v/1\x01" + rng.randbytes(100),
            ]
        )
    size = rng.choice(_SIZES), rng.choice(_SIZES)
    if content.startswith(b"\x89PNG"):
        bits, colour = rng.choice([(8, 0), (16, 0), (8, 2), (8, 3), (16, 6), (1, 0), (7, 9)])
        size = size if how == "claim" else (2**14, 2**14)
        header = struct.pack(">IIBBBBB", *size, bits, colour, 0, 0, rng.choice([0, 0, 1, 9]))
        chunks = dict(_chunks(content))
        data = bomb() if how == "bomb" else chunks.get(b"IDAT", b"")
        text = (b"iCCP", b"x\0\0" + bomb()) if rng.random() < 0.3 else (b"tEXt", b"a\0b")
        parts = [(b"IHDR", header), text, (b"IDAT", data), (b"IEND", b"")]
        return how, content[:8] + b"".join(_chunk(*part) for part in parts)
    return how, _spoiled_tiff(content, rng, size)


def _chunks(png: bytes) -> list[tuple[bytes, bytes]]:
    at, found = 8, []
    while at + 8 <= len(png):
        length, kind = struct.unpack_from(">I4s", png, at)
        found.append((kind, png[at + 8 : at + 8 + length]))
        at += length + 12
    return found


def _chunk(kind: bytes, data: bytes) -> bytes:
    return struct.pack(">I", len(data)) + kind + data + struct.pack(">I", zlib.crc32(kind + data))


def _spoiled_tiff(tiff: bytes, rng: random.Random, size: tuple[int, int]) -> bytes:
    """Other values in the directory of a TIFF of little endian, always another size."""
    content = bytearray(tiff)
    (at,) = struct.unpack_from("<I", content, 4)
    (entries,) = struct.unpack_from("<H", content, at)
    for n in range(entries):
        tag, _, count = struct.unpack_from("<HHI", content, at + 2 + 12 * n)
        if tag in (256, 257) and count == 1:
            struct.pack_into("<HI", content, at + 4 + 12 * n, 4, 1)
            struct.pack_into("<I", content, at + 10 + 12 * n, size[tag - 256])
        elif rng.random() < 0.2:
            struct.pack_into(
                "<I", content, at + 2 + 12 * n + rng.choice([4, 8]), rng.choice(_SIZES)
            )
    return bytes(content)


def spoil_folder(images: Path, secret: Path, rng: random.Random) -> str:
    """What was done to a folder of images to get at another file: a link, a name in its table."""
    how = rng.choice(["link", "link to the folder", "name", "name by a link"])
    if how == "link":
        one = rng.choice(sorted(images.glob("*.png")))
        one.unlink()
        one.symlink_to(secret)
    elif how == "link to the folder":
        (images / "more").symlink_to(secret.parent, target_is_directory=True)
    if how != "link":
        inside = {"link to the folder": "more/", "name by a link": "here/"}.get(how, "")
        if how == "name by a link":
            (images / "here").symlink_to(secret.parent)
        names = [
            *(f"{inside}{secret.name}", str(secret), f"../../decoy/{secret.name}"),
            *(f"./../../decoy/{secret.name}", f"0.png/../../../decoy/{secret.name}"),
            *("/dev/zero", "/etc/passwd", "//host/x.png", "file:///etc/passwd", "\\\\host\\x.png"),
        ]
        table = images / "metadata.csv"
        lines = table.read_text(encoding="utf-8").splitlines()
        n = rng.randrange(1, len(lines))
        lines[n] = ",".join([*lines[n].split(",")[:-1], rng.choice(names)])
        table.write_text("\n".join(lines), encoding="utf-8")
    return how
