"""How a robot reaches its team over a network: addresses, certificates, limits.

What is not asked for is not done: addresses are loopback, nobody is looked for by multicast, and
an address that other machines can reach is refused unless the options say ``public``. With
certificates everything is TLS with both sides checked; there is no half of it.
"""

import ipaddress
import re
import socket
from collections.abc import Mapping
from dataclasses import dataclass, field, fields
from pathlib import Path
from typing import Any

from fgplan.checks import check_positive
from fgplan.errors import InvalidInputError, UnknownNameError
from fgplan.team.envelope import MAX_ENVELOPE_BYTES

_ENDPOINT = re.compile(r"(tcp|tls)/(\[[0-9A-Fa-f:.]+\]|[A-Za-z0-9.-]+):([0-9]{1,5})")
_KEY_CHUNK = re.compile(r"[^/*$?#\s]{1,256}")
_PATHS = ("ca", "certificate", "key")


@dataclass(frozen=True, slots=True, kw_only=True)
class NetworkOptions:
    """The network as one robot uses it; most of it is the same for all.

    Attributes:
        name: First part of the team's keys; teams of different names do not hear each other.
        listen: Endpoints ``tcp/HOST:PORT``, or ``tls/HOST:PORT`` with certificates; port 0 is one
            that the system chooses. Empty is port 0 on the loopback. Every robot listens: peers do
            not relay for each other.
        connect: Endpoints of teammates. One is enough to join, it tells of the others; but robots
            that know each other only through one that is gone do not find each other again after
            a cut, so name all that are known. Its own in the list does no harm.
        public: Whether addresses that other machines can reach, and multicast, are wanted.
        multicast: Whether to look for teammates by multicast too.
        lease_s: Seconds of silence after which a frozen or cut-off robot counts as gone; one that
            ends is noticed at once.
        ca: Certificate of the authority that the team trusts, PEM; None is no TLS.
        certificate: Own certificate, PEM; its common name is the robot's name. ``{robot}`` in the
            path stands for that name.
        key: Private key of that certificate, PEM; ``{robot}`` as there.
        certificates: Certificate of each robot, for signatures; empty takes ``certificate`` of
            each robot where that path has ``{robot}``.
        largest_message_bytes: Larger messages are not read.
        kept_per_sender: Messages of each teammate that wait while this robot plans; of more the
            oldest are lost, so that nobody's sending ever blocks on a busy robot.
        kept_bytes: Bytes of each teammate that are taken out of the network ahead of their turn.
        messages_per_s: Messages of one teammate that are looked at in a second, on average.
    """

    name: str = "team"
    listen: tuple[str, ...] = ()
    connect: tuple[str, ...] = ()
    public: bool = False
    multicast: bool = False
    lease_s: float = 1.0
    ca: Path | None = None
    certificate: Path | None = None
    key: Path | None = None
    certificates: Mapping[str, Path] = field(default_factory=dict)
    largest_message_bytes: int = MAX_ENVELOPE_BYTES
    kept_per_sender: int = 16_384
    kept_bytes: int = 256 * 1024 * 1024
    messages_per_s: float = 20_000.0

    def __post_init__(self) -> None:
        """Check names, addresses and limits."""
        check_key_chunk(self.name, "team network name")
        check_positive(self.lease_s, "team network lease_s")
        for name in ("public", "multicast"):
            if not isinstance(getattr(self, name), bool):
                raise InvalidInputError(
                    f"team network {name}: expected true or false, got {getattr(self, name)!r}"
                )
        for name in ("largest_message_bytes", "kept_per_sender", "kept_bytes"):
            value = getattr(self, name)
            if isinstance(value, bool) or not isinstance(value, int) or value < 1:
                raise InvalidInputError(
                    f"team network {name}: expected a whole number above zero, got {value!r}"
                )
        check_positive(self.messages_per_s, "team network messages_per_s")
        if self.largest_message_bytes > MAX_ENVELOPE_BYTES:
            raise InvalidInputError(
                f"team network largest_message_bytes: expected at most {MAX_ENVELOPE_BYTES}, got "
                f"{self.largest_message_bytes}"
            )
        for name in _PATHS:
            value = getattr(self, name)
            object.__setattr__(self, name, None if value is None else Path(value))
        certificates = {robot: Path(path) for robot, path in dict(self.certificates).items()}
        object.__setattr__(self, "certificates", certificates)
        missing = [name for name in _PATHS if getattr(self, name) is None]
        if 0 < len(missing) < len(_PATHS):
            raise InvalidInputError(
                f"team network {missing[0]}: expected a file, got none; TLS needs ca, certificate "
                "and key"
            )
        if certificates and not self.secure:
            raise InvalidInputError(
                "team network certificates: expected ca, certificate and key with them, got none"
            )
        own = (f"{self.scheme}/127.0.0.1:0",)
        object.__setattr__(self, "listen", _endpoints(self.listen, "listen") or own)
        object.__setattr__(self, "connect", _endpoints(self.connect, "connect"))
        for which in ("listen", "connect"):
            for endpoint in getattr(self, which):
                self._check_endpoint(endpoint, which)
        if self.multicast and not self.public:
            raise InvalidInputError(
                "team network multicast: leaves this machine; say public = true if that is wanted"
            )

    @property
    def secure(self) -> bool:
        """Whether everything is mutual TLS and every message is signed."""
        return self.ca is not None

    @property
    def scheme(self) -> str:
        """Protocol of its endpoints."""
        return "tls" if self.secure else "tcp"

    def certificate_of(self, robot: str) -> Path:
        """Certificate of a robot of the team.

        Args:
            robot: Name.

        Returns:
            Its path.

        Raises:
            InvalidInputError: If neither ``certificates`` nor ``certificate`` says where it is.
        """
        if robot in self.certificates:
            return self.certificates[robot]
        if self.certificate is None or "{robot}" not in str(self.certificate):
            raise InvalidInputError(
                f"team network certificates: expected the certificate of robot {robot!r}, got "
                f"{', '.join(self.certificates) or 'none'}; or write {{robot}} in certificate"
            )
        return _for_robot(self.certificate, robot)

    def own_files(self, robot: str) -> tuple[Path, Path, Path]:
        """Authority, own certificate and private key of a robot.

        Args:
            robot: Name.

        Returns:
            Their paths.

        Raises:
            InvalidInputError: If there are none, or one is not there.
        """
        if self.ca is None or self.certificate is None or self.key is None:
            raise InvalidInputError("team network: expected ca, certificate and key, got none")
        own = (self.ca, _for_robot(self.certificate, robot), _for_robot(self.key, robot))
        for name, path in zip(_PATHS, own, strict=True):
            if not path.is_file():
                raise InvalidInputError(
                    f"team network {name}: robot {robot!r}: no file {str(path)!r}"
                )
        return own

    def _check_endpoint(self, endpoint: str, which: str) -> None:
        """Refuse what is no endpoint, another protocol, and what leaves the machine unasked."""
        match = _ENDPOINT.fullmatch(endpoint)
        if match is None or int(match[3]) > 65_535 or (which == "connect" and int(match[3]) == 0):
            raise InvalidInputError(
                f"team network {which}: expected tcp/HOST:PORT or tls/HOST:PORT, got {endpoint!r}"
            )
        if match[1] != self.scheme:
            why = "with" if self.secure else "without"
            raise InvalidInputError(
                f"team network {which}: expected {self.scheme}/HOST:PORT {why} certificates, got "
                f"{endpoint!r}"
            )
        if not self.public and not _is_loopback(match[2]):
            raise InvalidInputError(
                f"team network {which}: {endpoint!r} is not on this machine's loopback; say "
                "public = true if the network is wanted, and give ca, certificate and key"
            )


def check_key_chunk(name: str, what: str) -> str:
    """Check that a name can be a part of a key.

    Args:
        name: Of a team or robot.
        what: Of what it is the name, for the error.

    Returns:
        The name.

    Raises:
        InvalidInputError: If it is empty, too long, or has a character that keys reserve.
    """
    if not isinstance(name, str) or _KEY_CHUNK.fullmatch(name) is None:
        raise InvalidInputError(
            f"{what}: expected 1 to 256 characters without / * $ ? # and spaces, got {name!r}"
        )
    return name


def free_endpoint(scheme: str = "tcp") -> str:
    """An endpoint on the loopback whose port nobody uses now.

    The first robot of a team listens there and the others connect to it; those may listen on
    port 0. Another process may take the port in between; opening the transport then says so.

    Args:
        scheme: ``tcp``, or ``tls`` with certificates.

    Returns:
        ``SCHEME/127.0.0.1:PORT``.
    """
    with socket.socket() as found:
        found.bind(("127.0.0.1", 0))
        return f"{scheme}/127.0.0.1:{found.getsockname()[1]}"


def read_network(given: Mapping[str, Any], folder: Path | None = None) -> NetworkOptions:
    """Network options from plain data, as ``[team.network]`` of a scenario gives them.

    Args:
        given: Fields of ``NetworkOptions`` by name.
        folder: Folder that relative paths count from; None is the working folder.

    Returns:
        The options.

    Raises:
        UnknownNameError: If a field is not known; lists those that are.
        InvalidInputError: If a field has a value that is not usable.
    """
    if not isinstance(given, Mapping):
        raise InvalidInputError(f"team network: expected a table, got {given!r}")
    known = [item.name for item in fields(NetworkOptions)]
    for name in given:
        if name not in known:
            raise UnknownNameError(
                f"team network {name}: expected one of {', '.join(known)}, got {name!r}"
            )
    values = dict(given)
    for name in _PATHS:
        if values.get(name) is not None:
            values[name] = _placed(values[name], folder, name)
    if "certificates" in values:
        if not isinstance(values["certificates"], Mapping):
            raise InvalidInputError(
                "team network certificates: expected a table of files by robot, got "
                f"{values['certificates']!r}"
            )
        values["certificates"] = {
            robot: _placed(path, folder, f"certificates {robot}")
            for robot, path in values["certificates"].items()
        }
    return NetworkOptions(**values)


def _placed(path: Any, folder: Path | None, name: str) -> Path:  # noqa: ANN401 - as read
    """A path, counted from a folder."""
    if not isinstance(path, str | Path):
        raise InvalidInputError(f"team network {name}: expected a file name, got {path!r}")
    return Path(path) if folder is None else folder / path


def _for_robot(path: Path, robot: str) -> Path:
    """A path with the robot's name in it."""
    return Path(str(path).replace("{robot}", robot))


def _endpoints(given: Any, which: str) -> tuple[str, ...]:  # noqa: ANN401 - as read
    """Endpoints as a tuple."""
    if not isinstance(given, list | tuple) or not all(isinstance(item, str) for item in given):
        raise InvalidInputError(
            f"team network {which}: expected a list of endpoints, got {given!r}"
        )
    return tuple(given)


def _is_loopback(host: str) -> bool:
    """Whether a host is this machine alone."""
    if host == "localhost":
        return True
    try:
        return ipaddress.ip_address(host.strip("[]")).is_loopback
    except ValueError:
        return False
