"""Chunks that can be read alone: each has the schemas and channels of its messages.

The mcap library writes them once, into the chunk of the first message. Until a file is closed
they stand nowhere else, and damage to that one chunk would take the rest of the file with it.
"""

from __future__ import annotations

from mcap._chunk_builder import ChunkBuilder
from mcap.records import Channel, Message, Schema
from mcap.writer import Writer

#: Where the library's writer keeps the chunk that it fills.
_PLACE = "_Writer__chunk_builder"


class DescribedChunks(ChunkBuilder):
    """Describes each channel in every chunk that has messages of it."""

    def __init__(self) -> None:
        super().__init__()
        self._schemas: dict[int, Schema] = {}
        self._channels: dict[int, Channel] = {}
        self._described: set[int] = set()

    def add_schema(self, schema: Schema) -> None:
        """Register a schema.

        Parameters
        ----------
        schema : Schema
        """
        self._schemas[schema.id] = schema
        super().add_schema(schema)

    def add_channel(self, channel: Channel) -> None:
        """Register a channel, behind its schema.

        Parameters
        ----------
        channel : Channel
        """
        self._channels[channel.id] = channel
        self._described.add(channel.id)
        super().add_channel(channel)

    def add_message(self, message: Message) -> None:
        """Append a message, behind what describes it where the chunk does not say so yet.

        Parameters
        ----------
        message : Message
        """
        if message.channel_id not in self._described:
            channel = self._channels[message.channel_id]
            self.add_schema(self._schemas[channel.schema_id])
            self.add_channel(channel)
        super().add_message(message)

    def reset(self) -> None:
        """Begin the next chunk."""
        super().reset()
        self._described.clear()


def describe_in_every_chunk(writer: Writer) -> None:
    """Have a writer repeat schemas and channels where they are needed.

    Parameters
    ----------
    writer : mcap.writer.Writer
        Before anything is registered. One that keeps its chunks elsewhere stays as it is.
    """
    if isinstance(getattr(writer, _PLACE, None), ChunkBuilder):
        setattr(writer, _PLACE, DescribedChunks())
