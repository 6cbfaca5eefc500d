"""The seal at the end of a file: which format it is, and whether a byte of it has changed since it was written.

A serialised ONNX model may be followed by further entries of its last list, the metadata. The seal is such an entry,
`torchms.seal`, of fixed length: every ONNX tool reads it as metadata, and it can be checked without a parser.
"""

import hashlib

KEY = b"torchms.seal"
FORMAT = 1
"""Version of what a file holds; a reader refuses newer ones."""

_DIGITS = 3
_VALUE = _DIGITS + 1 + 64
# protobuf: ModelProto.metadata_props is field 14, a message of key (field 1) and value (field 2), each length-prefixed.
_ENTRY = bytes([1 << 3 | 2, len(KEY)]) + KEY + bytes([2 << 3 | 2, _VALUE])
_PREFIX = bytes([14 << 3 | 2, len(_ENTRY) + _VALUE]) + _ENTRY
_LENGTH = len(_PREFIX) + _VALUE


def sealed(model: bytes) -> bytes:
    """`model`, a serialised ModelProto, with the seal."""
    digest = hashlib.sha256(model).hexdigest()
    return model + _PREFIX + f"{FORMAT:0{_DIGITS}d} {digest}".encode()


def check(content: bytes, name: str) -> None:
    """Raise ValueError if `content` is not a file of ours, is damaged or is of a newer format."""
    seal = content[-_LENGTH:]
    if not seal.startswith(_PREFIX):
        if b"torchms.conventions" in content:
            raise ValueError(
                f"{name} is damaged, or was changed by another tool: its last bytes are not the seal that "
                "torchms.onnx.export wrote. Export it again."
            )
        raise ValueError(f"{name} was not written by torchms.onnx.export: it carries no seal of it.")
    version, _, digest = seal[len(_PREFIX) :].decode("ascii", "replace").partition(" ")
    if not version.isdigit():
        raise ValueError(f"{name} is damaged: its seal cannot be read. Export it again.")
    if int(version) > FORMAT:
        raise ValueError(
            f"{name} is of format {int(version)}; this torchms reads up to {FORMAT}. Install a newer torchms."
        )
    if hashlib.sha256(content[:-_LENGTH]).hexdigest() != digest:
        raise ValueError(f"{name} is damaged: its content does not match its seal. Export it again.")
