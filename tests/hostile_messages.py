"""Messages as an enemy would send them: honest ones, changed in ways that must or may be refused.

A *scene* is a robot in the middle of its work, and honest messages for it. ``MUST`` are changes
after which nobody may take the message in; ``MAY`` are changes that can leave it sensible.
"""

import dataclasses
import hashlib
import math
import struct
from types import ModuleType

import msgspec
import numpy as np

from fgplan.errors import FgplanError
from fgplan.team.admission import Admission
from fgplan.team.envelope import Envelope, Inbox
from fgplan.team.network_options import NetworkOptions

LARGEST = 300_000


@dataclasses.dataclass
class Scene:
    """A robot, its step, honest messages for it, and when it is."""

    name: str
    robot: str
    robots: tuple
    step: object
    state: object
    letters: list
    now_s: float = 0.0
    session: int | None = None


_FROZEN = ("Announcement", "CandidatePath", "Envelope", "Ledger", "Log")
"""Classes whose objects never change; the digest of each object is computed once."""

_KNOWN = {}


def digest(value):
    """What a state holds, its set-up aside; values alone, so equal states have equal digests."""
    found = hashlib.blake2b(digest_size=16)
    _feed(found.update, value, frozenset())
    return found.digest()


def _feed(update, value, above):
    """One value and what is in it."""
    if isinstance(value, np.ndarray):
        update(f"{value.dtype}{value.shape}".encode())
        update(np.ascontiguousarray(value).tobytes())
    elif value is None or isinstance(value, bool | int | float | str | bytes | np.generic):
        update(repr(value).encode())
    elif isinstance(value, np.random.Generator):
        update(repr(value.bit_generator.state).encode())
    elif id(value) in above or callable(value) or isinstance(value, ModuleType):
        update(type(value).__name__.encode())
    elif isinstance(value, dict):
        for key in value:
            _feed(update, key, above)
            _feed(update, value[key], above | {id(value)})
    elif isinstance(value, set | frozenset):
        update(repr(sorted(map(repr, value))).encode())
    elif isinstance(value, tuple | list):
        update(str(len(value)).encode())
        for item in value:
            _feed(update, item, above | {id(value)})
    elif type(value).__name__ in _FROZEN:
        if id(value) not in _KNOWN:
            own = hashlib.blake2b(digest_size=16)
            _feed_fields(own.update, value, above)
            _KNOWN[id(value)] = (value, own.digest())  # kept, so that no other has its id
        update(_KNOWN[id(value)][1])
    else:
        _feed_fields(update, value, above)


def _feed_fields(update, value, above):
    """An object field by field."""
    update(type(value).__name__.encode())
    names = getattr(value, "__struct_fields__", None)
    if names is None and dataclasses.is_dataclass(value):
        names = [field.name for field in dataclasses.fields(value)]
    if names is None:
        names = sorted(vars(value)) if hasattr(value, "__dict__") else []
    for name in names:
        if name not in ("setup", "problem", "evaluator_state", "fields"):
            update(name.encode())
            _feed(update, getattr(value, name), above | {id(value)})


def payload_changed(envelope, change, generator):
    """The envelope with its payload decoded, changed and encoded again."""
    tree = msgspec.msgpack.decode(envelope.payload)
    places = list(_places(tree, ()))
    for place in generator.permutation(len(places)):
        path, leaf = places[place]
        replaced = change(leaf, generator)
        if replaced is not NotImplemented:
            payload = msgspec.msgpack.encode(_with(tree, path, replaced))
            return msgspec.structs.replace(envelope, payload=payload)
    return None


def _places(tree, path):
    """Every leaf with the way to it."""
    if isinstance(tree, dict):
        for key in tree:
            yield from _places(tree[key], (*path, key))
    elif isinstance(tree, list):
        for index, item in enumerate(tree):
            yield from _places(item, (*path, index))
    else:
        yield path, tree


def _with(tree, path, leaf):
    """A copy of the tree with one leaf replaced."""
    if not path:
        return leaf
    if isinstance(tree, dict):
        return {
            key: _with(item, path[1:], leaf) if key == path[0] else item
            for key, item in tree.items()
        }
    return [
        _with(item, path[1:], leaf) if index == path[0] else item for index, item in enumerate(tree)
    ]


def _not_a_number(leaf, generator):
    if isinstance(leaf, float):
        return [math.nan, math.inf, -math.inf][generator.integers(3)]
    if isinstance(leaf, bytes) and len(leaf) % 8 == 0 and len(leaf) > 0:
        at = 8 * int(generator.integers(len(leaf) // 8))
        return leaf[:at] + struct.pack("<d", math.nan) + leaf[at + 8 :]
    return NotImplemented


def _another_size(leaf, generator):
    if isinstance(leaf, bytes) and len(leaf) > 0:
        cut = int(generator.integers(1, min(len(leaf), 9)))
        return leaf[:-cut] if generator.integers(2) else leaf + leaf[:cut]
    return NotImplemented


def _another_type(leaf, generator):
    return [{}, [[]], {"a": 1}, msgspec.Raw(b"\xc1")][generator.integers(3)]


def _too_deep(leaf, generator):
    opened = [b"\x91", b"\x81\xa1a"][generator.integers(2)]
    return msgspec.Raw(opened * 20_000 + b"\xc0")


def _another_number(leaf, generator):
    if isinstance(leaf, bool) or not isinstance(leaf, int | float):
        return NotImplemented
    few = [-1, 0, 1, 2, 2**31 - 1, 2**31, 2**53, 2**63 - 1, 2**64 - 1, -(2**63), 1e308, -0.5]
    return few[generator.integers(len(few))]


def _another_text(leaf, generator):
    if isinstance(leaf, str):
        return ["", "x", leaf + "x", "x" * 300, "a/b"][generator.integers(5)]
    return NotImplemented


def _other_bytes(leaf, generator):
    if isinstance(leaf, bytes) and len(leaf) > 0:
        data = bytearray(leaf)
        data[int(generator.integers(len(data)))] ^= 1 << int(generator.integers(8))
        return bytes(data)
    return NotImplemented


def _of_payload(change):
    def changed(scene, sender, envelope, generator):
        found = payload_changed(envelope, change, generator)
        return None if found is None else (sender, found.encoded)

    return changed


def _of_envelope(**changes):
    def changed(scene, sender, envelope, generator):
        return sender, msgspec.structs.replace(envelope, **changes).encoded

    return changed


def _truncated(scene, sender, envelope, generator):
    return sender, envelope.encoded[: int(generator.integers(len(envelope.encoded)))]


def _payload_truncated(scene, sender, envelope, generator):
    if not envelope.payload:
        return None
    cut = envelope.payload[: int(generator.integers(len(envelope.payload)))]
    return sender, msgspec.structs.replace(envelope, payload=cut).encoded


def _oversized(scene, sender, envelope, generator):
    return sender, msgspec.structs.replace(envelope, payload=b"\0" * LARGEST).encoded


def _version(scene, sender, envelope, generator):
    return sender, envelope.encoded.replace(b"envelope.v1", b"envelope.v2")


def _payload_version(scene, sender, envelope, generator):
    if b".v1" not in envelope.payload:
        return None
    payload = envelope.payload.replace(b".v1", b".v7")
    return sender, msgspec.structs.replace(envelope, payload=payload).encoded


def _as_another(scene, sender, envelope, generator):
    """A teammate's message under a third robot's key."""
    others = [name for name in scene.robots if name not in (sender, scene.robot)]
    if not others or envelope.kind in ("announcement", "withdrawal", "refusal"):
        return None
    return others[int(generator.integers(len(others)))], envelope.encoded


def _of_a_stranger(scene, sender, envelope, generator):
    return sender, msgspec.structs.replace(envelope, robot="mallory").encoded


def _by_a_stranger(scene, sender, envelope, generator):
    return "mallory", msgspec.structs.replace(envelope, robot="mallory").encoded


def _from_oneself(scene, sender, envelope, generator):
    return scene.robot, msgspec.structs.replace(envelope, robot=scene.robot).encoded


def _prior(scene, sender, envelope, generator):
    if b"prior_digest" not in envelope.payload:
        return None
    content = msgspec.msgpack.decode(envelope.payload)
    payload = msgspec.msgpack.encode({**content, "prior_digest": "0" * 64})
    return sender, msgspec.structs.replace(envelope, payload=payload).encoded


def _bytes_flipped(scene, sender, envelope, generator):
    data = bytearray(envelope.encoded)
    for at in generator.integers(len(data), size=int(generator.integers(1, 5))):
        data[int(at)] = int(generator.integers(256))
    return sender, bytes(data)


def _noise(scene, sender, envelope, generator):
    return sender, generator.bytes(int(generator.integers(1, 400)))


def _other_place(scene, sender, envelope, generator):
    """Replayed, or ahead of its time."""
    step = int(generator.integers(-3, 4))
    sequences = [max(envelope.sequence + step, 0), 0, 2**31, 2**63, 2**64 - 1]
    sequence = sequences[int(generator.integers(len(sequences)))]
    return sender, msgspec.structs.replace(envelope, sequence=sequence).encoded


def _other_basis(scene, sender, envelope, generator):
    basis = {name: int(generator.integers(5)) for name in scene.robots}
    return sender, msgspec.structs.replace(envelope, basis=basis).encoded


def _other_parent(scene, sender, envelope, generator):
    return sender, msgspec.structs.replace(envelope, parent=generator.bytes(16)).encoded


def _other_kind(scene, sender, envelope, generator):
    kinds = sorted({letter.kind for _, letter in scene.letters} | {"sensed", "ask", "status"})
    kind = kinds[int(generator.integers(len(kinds)))]
    return sender, msgspec.structs.replace(envelope, kind=kind).encoded


def _untouched(scene, sender, envelope, generator):
    return sender, envelope.encoded


MUST = {
    "truncated": _truncated,
    "payload truncated": _payload_truncated,
    "oversized": _oversized,
    "version": _version,
    "payload version": _payload_version,
    "as another": _as_another,
    "of a stranger": _of_a_stranger,
    "by a stranger": _by_a_stranger,
    "from oneself": _from_oneself,
    "too deep": _of_payload(_too_deep),
    "another type": _of_payload(_another_type),
    "prior": _prior,
    "noise": _noise,
}

MAY = {
    "not a number": _of_payload(_not_a_number),
    "another size": _of_payload(_another_size),
    "another number": _of_payload(_another_number),
    "another text": _of_payload(_another_text),
    "other bytes": _of_payload(_other_bytes),
    "bytes flipped": _bytes_flipped,
    "session": _of_envelope(session=2**40),
    "other place": _other_place,
    "other basis": _other_basis,
    "other parent": _other_parent,
    "other kind": _other_kind,
    "untouched": _untouched,
}


class Target:
    """A scene under fire: what an endpoint does with a message, and a watch on the state."""

    def __init__(self, scene):
        self.scene = scene
        self.state = scene.state
        self.gate = Admission(
            scene.robot,
            scene.robots,
            NetworkOptions(largest_message_bytes=LARGEST, messages_per_s=1e9),
            session=scene.session,
        )
        self.held = digest(self.state)
        self.taken = 0

    def hit(self, sender, data):
        """Whether the message was taken in; raises if it crashed the step or left a trace."""
        envelope = self.gate.admit(sender, data, self.scene.now_s)
        if envelope is None:
            return False
        try:
            after, _ = self.scene.step(self.state, Inbox(self.scene.now_s, (envelope,), None))
        except FgplanError:
            assert digest(self.state) == self.held, "what was refused has changed the state"
            return False
        held = digest(after)
        taken = held != self.held
        self.state, self.held = after, held
        self.taken += taken
        return taken


def letter_of(data):
    """An envelope as it comes over a wire: nothing kept with it."""
    return msgspec.msgpack.decode(data, type=Envelope)
