"""A chunk of an MCAP file: decompressed within its declared size and checked."""

from __future__ import annotations

import struct
import threading
import zlib
from dataclasses import dataclass
from typing import TYPE_CHECKING

from hydro_ident.errors import BagError

if TYPE_CHECKING:
    from zstandard import ZstdDecompressor

_KEPT = threading.local()
_FIXED = struct.Struct("<QQQII")  # start, end, uncompressed size, crc, length of compression name


class ChunkError(BagError):
    """A chunk that cannot be used, with why.

    Attributes
    ----------
    checksum : bool
        Because its checksum does not hold.
    """

    def __init__(self, text: str, *, checksum: bool = False) -> None:
        super().__init__(text)
        self.checksum = checksum


@dataclass(frozen=True, slots=True)
class Chunk:
    """The records of a chunk.

    Attributes
    ----------
    data : bytes
    compression : str
        "none", "lz4" or "zstd".
    checked : bool
        It carried a checksum, and the checksum held.
    """

    data: bytes
    compression: str
    checked: bool


def declared_bytes(body: bytes) -> int:
    """Size to which a chunk says that it unfolds; 0 where its head is not complete.

    `body` is the chunk's record.
    """
    return int(_FIXED.unpack_from(body, 0)[2]) if len(body) >= _FIXED.size else 0


def decompress_chunk(body: bytes, limit_bytes: int, *, truncated: bool = False) -> Chunk:
    """Decompress a chunk record's body.

    Parameters
    ----------
    body : bytes
        The record, or what is left of it where the file was cut off.
    limit_bytes : int
        Largest size that is decompressed.
    truncated : bool
        The file ends inside this chunk: decompress as far as possible, without checksum.

    Returns
    -------
    Chunk

    Raises
    ------
    ChunkError
        Malformed, larger than declared or than the limit, unknown compression or a checksum
        that does not hold.
    """
    if len(body) < _FIXED.size:
        raise ChunkError("its head is not complete")
    _, _, size, crc, name_length = _FIXED.unpack_from(body, 0)
    start = _FIXED.size + name_length + 8
    if name_length > 16 or len(body) < start:
        raise ChunkError("its head is not complete")
    name = body[_FIXED.size : _FIXED.size + name_length].decode("ascii", "replace")
    if size > limit_bytes:
        raise ChunkError(f"it declares {size} bytes, more than {limit_bytes} for this file")
    (length,) = struct.unpack_from("<Q", body, start - 8)
    if not truncated and length > len(body) - start:
        raise ChunkError(f"it declares {length} compressed bytes and holds {len(body) - start}")
    data = _decompress(name, body[start : start + length], size)
    if truncated:
        return Chunk(data, name or "none", False)
    if len(data) != size:
        raise ChunkError(f"it declares {size} bytes and holds {len(data)}")
    if crc and zlib.crc32(data) != crc:
        raise ChunkError("its checksum does not match: bytes changed", checksum=True)
    return Chunk(data, name or "none", bool(crc))


def _decompress(name: str, packed: bytes, size: int) -> bytes:
    if name == "":
        return packed
    if name == "zstd":
        return _zstd(packed, size)
    if name == "lz4":
        return _lz4(packed, size)
    raise ChunkError(f"expected compression none, lz4 or zstd, found '{name}'")


def _zstd(packed: bytes, size: int) -> bytes:
    import zstandard

    try:
        # The frame's own size rules the allocation: it must not exceed the declared one.
        declared = zstandard.frame_content_size(packed)
        if declared > size:
            raise ChunkError(f"it declares {size} bytes and its frame {declared}")
        if declared < 0:
            return _zstd_stream(packed, size)
        return bytes(_decompressor().decompress(packed, max_output_size=size))
    except zstandard.ZstdError:
        return _zstd_stream(packed, size)


def _decompressor() -> ZstdDecompressor:
    """That of this thread: making one takes as long as unfolding some ten thousand bytes."""
    import zstandard

    try:
        kept: ZstdDecompressor = _KEPT.decompressor
    except AttributeError:
        kept = _KEPT.decompressor = zstandard.ZstdDecompressor()
    return kept


def _zstd_stream(packed: bytes, size: int) -> bytes:
    """As much as decompresses, up to `size`: for frames cut off or without a size."""
    import io

    import zstandard

    out = bytearray()
    try:
        with zstandard.ZstdDecompressor().stream_reader(io.BytesIO(packed)) as reader:
            while len(out) < size and (piece := reader.read(min(1 << 17, size - len(out)))):
                out += piece
    except zstandard.ZstdError as error:
        if not out:
            raise ChunkError(f"it does not decompress ({error})") from error
    return bytes(out)


def _lz4(packed: bytes, size: int) -> bytes:
    import lz4.frame

    try:
        return bytes(lz4.frame.LZ4FrameDecompressor().decompress(packed, max_length=size))
    except RuntimeError as error:
        raise ChunkError(f"it does not decompress ({error})") from error
