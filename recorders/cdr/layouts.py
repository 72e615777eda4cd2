"""Messages of every registered type, read from plain CDR and written to it.

This is the general codec, which takes either byte order; `recorders.cdr.codec` puts byte templates in front of it.
"""

from recorders.cdr.message_format import FORMATS
from recorders.cdr.stream import CdrReader, CdrWriter
from recorders.errors import MessageError
from recorders.messages.message_types import Message, TypedMessage
from recorders.text.wording import names_text


def read_message(type_name: str, data: bytes) -> Message:
    """Decode one message of any registered type.

    Raises
    ------
    MessageError
        If the type is unknown or the bytes are not a message of it.
    """
    known = FORMATS.get(type_name)
    if known is None:
        raise MessageError(f"expected one of {names_text(FORMATS.names())}, found {type_name!r}")
    try:
        reader = CdrReader(data)
        message: Message = known.read(reader)
        reader.finish()
    except MessageError as error:
        raise MessageError(f"{type_name}: {error}") from None
    return message


def write_message(message: TypedMessage) -> CdrWriter:
    """Encode one message as little-endian CDR; the writer holds the payload and where its floats are.

    Raises
    ------
    MessageError
        If it is of no registered type.
    """
    known = FORMATS.get(str(getattr(type(message), "TYPE", "")))
    if known is None or type(message) is not known.message:
        raise MessageError(f"expected a message of a registered type, found {type(message).__name__}")
    writer = CdrWriter()
    known.write(writer, message)
    return writer
