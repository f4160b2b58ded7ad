"""Jobs of the benchmark: what is done is what their names say."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from mcap.reader import make_reader

from hydro_ident.bench import bag_jobs


@pytest.fixture(scope="module")
def bag(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return bag_jobs.write_small(tmp_path_factory.mktemp("bag"))


def test_the_floor_of_reading_a_bag_touches_every_byte_of_every_chunk(
    bag: Path, tmp_path: Path
) -> None:
    (file,) = bag.glob("*.mcap")
    size, total = bag_jobs.unpacked(file)
    bag_jobs._all_unpacked(file)
    with open(file, "rb") as stream:
        reader = make_reader(stream)
        messages = sum(len(m.data) for _, _, m in reader.iter_messages())
        summary = reader.get_summary()
    assert summary is not None
    assert size == sum(one.uncompressed_size for one in summary.chunk_indexes) > messages
    one = min(summary.chunk_indexes, key=lambda c: c.chunk_start_offset)
    cut = tmp_path / "cut.mcap"
    # The first chunk alone, between the magic words.
    end = one.chunk_start_offset + one.chunk_length
    content = file.read_bytes()
    cut.write_bytes(content[:end] + content[-bag_jobs.MAGIC_SIZE :])
    alone, part = bag_jobs.unpacked(cut)
    assert alone == one.uncompressed_size
    assert 0 < part != total


def test_the_sum_is_that_of_the_bytes(bag: Path) -> None:
    import zstandard
    from mcap.data_stream import ReadDataStream
    from mcap.records import Chunk
    from mcap.stream_reader import StreamReader

    (file,) = bag.glob("*.mcap")
    total, unpacker = 0, zstandard.ZstdDecompressor()
    with open(file, "rb") as stream:
        for record in StreamReader(ReadDataStream(stream), emit_chunks=True).records:
            if isinstance(record, Chunk):
                data = np.frombuffer(unpacker.decompress(record.data), np.uint8)
                whole = len(data) // 8 * 8
                words = data[:whole].reshape(-1, 8).astype(np.uint64) << np.arange(
                    0, 64, 8, dtype=np.uint64
                )
                total += int(words.sum()) + int(data[whole:].sum())
    assert bag_jobs.unpacked(file)[1] == total % 2**64
