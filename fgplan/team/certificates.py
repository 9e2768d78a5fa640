"""An authority and certificates for a team: enough to run robots with mutual TLS.

One authority of the team's own, one certificate and key a robot, the common name being the robot's
name. The authority's private key is not written: whoever can sign with it can be any robot, so
later certificates mean a new set. A set of an authority that you have already serves as well.
"""

import ipaddress
import os
from collections.abc import Sequence
from datetime import UTC, datetime, timedelta
from pathlib import Path
from typing import Any

from fgplan.checks import check_positive
from fgplan.errors import InvalidInputError
from fgplan.team.credentials import import_x509
from fgplan.team.network_options import check_key_chunk


def make_certificates(
    folder: str | os.PathLike[str],
    robots: Sequence[str],
    *,
    hosts: Sequence[str] = ("127.0.0.1", "localhost"),
    days: float = 365.0,
) -> tuple[Path, ...]:
    """Write ``ca.pem``, and ``ROBOT.pem`` and ``ROBOT.key`` of each robot.

    Args:
        folder: Where; made if it is not there. Keys are readable by their owner alone.
        robots: Names.
        hosts: Addresses and host names that the certificates are good for.
        days: How long they are valid.

    Returns:
        The files.

    Raises:
        InvalidInputError: If a name cannot be used, or there are files of that name already.
        MissingExtraError: If ``cryptography`` is not installed.
    """
    x509 = import_x509()
    from cryptography.hazmat.primitives.asymmetric import ec

    check_positive(days, "certificates days")
    where = Path(folder)
    paths = [where / "ca.pem"]
    for robot in robots:
        check_key_chunk(robot, "certificates: robot")
        if len(robot) > 64 or robot == "ca":
            raise InvalidInputError(
                f"certificates: robot {robot!r}: expected a name of at most 64 characters, not 'ca'"
            )
        paths += [where / f"{robot}.pem", where / f"{robot}.key"]
    for path in paths:
        if path.exists():
            raise InvalidInputError(f"certificates: {path} is there already; choose a new folder")
    where.mkdir(parents=True, exist_ok=True)
    places = [_general_name(x509, host) for host in hosts]
    authority_key = ec.generate_private_key(ec.SECP256R1())
    # Robots' clocks differ: valid from an hour ago.
    since = datetime.now(UTC) - timedelta(hours=1)
    until = since + timedelta(days=days, hours=1)
    authority_name = _name(x509, "fgplan team authority")
    authority = _signed(
        _builder(x509, authority_name, authority_name, authority_key, since, until)
        .add_extension(x509.BasicConstraints(ca=True, path_length=0), critical=True)
        .add_extension(_usage(x509, authority=True), critical=True),
        authority_key,
    )
    _write(paths[0], authority, 0o644)
    for robot in robots:
        key = ec.generate_private_key(ec.SECP256R1())
        certificate = _signed(
            _builder(x509, _name(x509, robot), authority_name, key, since, until)
            .add_extension(x509.BasicConstraints(ca=False, path_length=None), critical=True)
            .add_extension(_usage(x509, authority=False), critical=True)
            .add_extension(
                x509.ExtendedKeyUsage(
                    [
                        x509.ExtendedKeyUsageOID.SERVER_AUTH,
                        x509.ExtendedKeyUsageOID.CLIENT_AUTH,
                    ]
                ),
                critical=False,
            )
            .add_extension(x509.SubjectAlternativeName(places), critical=False),
            authority_key,
        )
        _write(where / f"{robot}.pem", certificate, 0o644)
        _write(where / f"{robot}.key", _key_data(key), 0o600)
    return tuple(paths)


def _builder(
    x509: Any,  # noqa: ANN401 - a module of an extra, and what it makes
    subject: Any,  # noqa: ANN401
    issuer: Any,  # noqa: ANN401
    key: Any,  # noqa: ANN401
    since: datetime,
    until: datetime,
) -> Any:  # noqa: ANN401
    """What all certificates have."""
    return (
        x509.CertificateBuilder()
        .subject_name(subject)
        .issuer_name(issuer)
        .public_key(key.public_key())
        .serial_number(x509.random_serial_number())
        .not_valid_before(since)
        .not_valid_after(until)
    )


def _signed(builder: Any, key: Any) -> bytes:  # noqa: ANN401
    """The certificate in PEM."""
    from cryptography.hazmat.primitives import hashes
    from cryptography.hazmat.primitives.serialization import Encoding

    data: bytes = builder.sign(key, hashes.SHA256()).public_bytes(Encoding.PEM)
    return data


def _usage(x509: Any, *, authority: bool) -> Any:  # noqa: ANN401
    """What the key may be used for."""
    return x509.KeyUsage(
        digital_signature=not authority,
        content_commitment=False,
        key_encipherment=False,
        data_encipherment=False,
        key_agreement=False,
        key_cert_sign=authority,
        crl_sign=authority,
        encipher_only=False,
        decipher_only=False,
    )


def _name(x509: Any, common_name: str) -> Any:  # noqa: ANN401
    """A name of one part."""
    return x509.Name([x509.NameAttribute(x509.NameOID.COMMON_NAME, common_name)])


def _general_name(x509: Any, host: str) -> Any:  # noqa: ANN401
    """An address or host name as certificates hold it."""
    try:
        return x509.IPAddress(ipaddress.ip_address(host))
    except ValueError:
        return x509.DNSName(host)


def _key_data(key: Any) -> bytes:  # noqa: ANN401
    """A private key in PEM."""
    from cryptography.hazmat.primitives.serialization import (
        Encoding,
        NoEncryption,
        PrivateFormat,
    )

    data: bytes = key.private_bytes(Encoding.PEM, PrivateFormat.PKCS8, NoEncryption())
    return data


def _write(path: Path, data: bytes, mode: int) -> None:
    """Write a new file with its rights from the start."""
    number = os.open(path, os.O_WRONLY | os.O_CREAT | os.O_EXCL, mode)
    with os.fdopen(number, "wb") as file:
        file.write(data)
