"""Types of arrays."""

from typing import TypeAlias

from recorders.messages.validation import FloatArray

Floats: TypeAlias = FloatArray
"""Array of double precision."""
