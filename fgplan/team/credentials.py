"""Signatures of envelopes, with the certificates that the robots have for TLS.

The network tells who sent a message; the signature tells who wrote it, also where a teammate
passes it on. Signed is

    "fgplan/NAME" 0x00 envelope with an empty signature, as msgpack

by ECDSA on P-256 with SHA-256. A certificate counts for a robot if the team's authority issued it,
its common name is the robot's name, and it has not run out.
"""

from collections.abc import Mapping, Sequence
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import msgspec

from fgplan.errors import InvalidInputError, MissingExtraError
from fgplan.team.envelope import Envelope
from fgplan.team.network_options import NetworkOptions


class Credentials:
    """Signs for one robot and verifies for all."""

    def __init__(self, name: str, key: Any, public_keys: Mapping[str, Any]) -> None:  # noqa: ANN401
        """Keep the keys.

        Args:
            name: The team's, as in its keys.
            key: Private key of the robot, of the package ``cryptography``.
            public_keys: Public key of each robot.
        """
        self._context = f"fgplan/{name}".encode() + b"\0"
        self._key = key
        self._public_keys = dict(public_keys)

    @classmethod
    def read(cls, robot: str, robots: Sequence[str], options: NetworkOptions) -> "Credentials":
        """Read the keys of a robot and the certificates of its team.

        Args:
            robot: Who signs.
            robots: All names, in the order of the team.
            options: Where the files are.

        Returns:
            The credentials.

        Raises:
            InvalidInputError: If a file is missing or malformed, a certificate is not the robot's
                or not of the team's authority or has run out, or a key is not on P-256.
            MissingExtraError: If ``cryptography`` is not installed.
        """
        import_x509()
        from cryptography.hazmat.primitives.asymmetric import ec
        from cryptography.hazmat.primitives.serialization import load_pem_private_key

        ca_path, own_path, key_path = options.own_files(robot)
        authority = _certificate(ca_path)
        public_keys = {
            name: _public_key(
                own_path if name == robot else options.certificate_of(name), name, authority
            )
            for name in robots
        }
        try:
            key = load_pem_private_key(_data(key_path), password=None)
        except (ValueError, TypeError) as error:
            raise InvalidInputError(f"key of robot {robot!r}: {key_path}: {error}") from error
        if not isinstance(key, ec.EllipticCurvePrivateKey) or (
            key.public_key().public_numbers() != public_keys[robot].public_numbers()
        ):
            raise InvalidInputError(
                f"key of robot {robot!r}: {key_path}: expected the private key of its certificate"
            )
        return cls(options.name, key, public_keys)

    def sign(self, envelope: Envelope) -> Envelope:
        """An envelope with this robot's signature; the same each time.

        Args:
            envelope: Of this robot.

        Returns:
            The envelope, signed.
        """
        from cryptography.hazmat.primitives import hashes
        from cryptography.hazmat.primitives.asymmetric import ec

        method = ec.ECDSA(hashes.SHA256(), deterministic_signing=True)
        signature = self._key.sign(self._signed(envelope), method)
        return msgspec.structs.replace(envelope, signature=signature)

    def verify(self, envelope: Envelope) -> None:
        """Check that the robot which an envelope names has written it.

        Args:
            envelope: As received.

        Raises:
            InvalidInputError: If it has not.
        """
        from cryptography.exceptions import InvalidSignature
        from cryptography.hazmat.primitives import hashes
        from cryptography.hazmat.primitives.asymmetric import ec

        what = f"{envelope.kind} {envelope.sequence} of robot {envelope.robot!r}"
        if envelope.robot not in self._public_keys:
            raise InvalidInputError(f"{what}: expected a robot with a certificate")
        if not envelope.signature:
            raise InvalidInputError(f"{what}: expected a signature, got none")
        try:
            self._public_keys[envelope.robot].verify(
                envelope.signature, self._signed(envelope), ec.ECDSA(hashes.SHA256())
            )
        except InvalidSignature as error:
            raise InvalidInputError(f"{what}: not signed by that robot") from error

    def _signed(self, envelope: Envelope) -> bytes:
        """What is signed."""
        return self._context + msgspec.structs.replace(envelope, signature=b"").encoded


def import_x509() -> Any:  # noqa: ANN401 - a module of an extra
    """The module ``cryptography.x509``, or how to get it.

    Raises:
        MissingExtraError: If it is not installed.
    """
    try:
        from cryptography import x509
    except ImportError as error:
        raise MissingExtraError(
            f"certificates need cryptography, which could not be imported ({error}); install the "
            "extra: pip install 'fgplan[net]'"
        ) from error
    return x509


def _public_key(path: Path, robot: str, authority: Any) -> Any:  # noqa: ANN401
    """Public key of a certificate that counts for a robot."""
    from cryptography.exceptions import InvalidSignature
    from cryptography.hazmat.primitives.asymmetric import ec

    certificate = _certificate(path)
    what = f"certificate of robot {robot!r}: {path}"
    names = [
        attribute.value
        for attribute in certificate.subject
        if attribute.oid == import_x509().NameOID.COMMON_NAME
    ]
    if names != [robot]:
        raise InvalidInputError(f"{what}: expected common name {robot!r}, got {names}")
    try:
        certificate.verify_directly_issued_by(authority)
    except (InvalidSignature, ValueError, TypeError) as error:
        raise InvalidInputError(f"{what}: not issued by the team's authority") from error
    now = datetime.now(UTC)
    if not certificate.not_valid_before_utc <= now <= certificate.not_valid_after_utc:
        raise InvalidInputError(
            f"{what}: valid from {certificate.not_valid_before_utc} to "
            f"{certificate.not_valid_after_utc}, and now is {now}; make a new one"
        )
    key = certificate.public_key()
    if not isinstance(key, ec.EllipticCurvePublicKey) or not isinstance(key.curve, ec.SECP256R1):
        raise InvalidInputError(f"{what}: expected a key on the curve P-256")
    return key


def _certificate(path: Path) -> Any:  # noqa: ANN401
    """A certificate in PEM."""
    try:
        return import_x509().load_pem_x509_certificate(_data(path))
    except ValueError as error:
        raise InvalidInputError(f"certificate {path}: {error}") from error


def _data(path: Path) -> bytes:
    """Bytes of a file."""
    try:
        return path.read_bytes()
    except OSError as error:
        raise InvalidInputError(f"team network: {path}: {error.strerror}") from error
