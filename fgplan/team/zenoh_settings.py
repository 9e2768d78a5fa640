"""Settings of the zenoh session of one robot: who it reaches, and who may write what.

    PREFIX/SENDER/to/RECEIVER    a message; to all teammates RECEIVER is *
    PREFIX/SENDER/alive/ID       a token that is there as long as SENDER is; ID of its session

with PREFIX = fgplan/NAME. With certificates each robot checks on its own side that what comes over
a link with the common name r lies under PREFIX/r, and that r hears only what is sent to r.

Peers do not relay for each other, so everybody listens, and tells others of those it knows
(gossip). A sender waits where the network is full (``block``). Shared memory is off: processes
that are killed would leave their segments behind.
"""

from collections.abc import Sequence
from typing import Any

from fgplan.team.network_options import NetworkOptions

FRAME_BYTES = 64 * 1024
"""What zenoh adds to a message at most."""

_ALL_MESSAGES = (
    "put",
    "delete",
    "declare_subscriber",
    "declare_queryable",
    "query",
    "reply",
    "liveliness_token",
    "liveliness_query",
    "declare_liveliness_subscriber",
)


def zenoh_settings(robot: str, robots: Sequence[str], options: NetworkOptions) -> dict[str, Any]:
    """Settings of zenoh for one robot.

    Args:
        robot: Name.
        robots: All names, in the order of the team.
        options: The network.

    Returns:
        Values by path, as zenoh's ``Config.insert_json5`` takes them.

    Raises:
        InvalidInputError: If a file of its certificates is not there.
    """
    settings: dict[str, Any] = {
        "mode": "peer",
        "listen/endpoints": list(options.listen),
        # Its own address may be in a list that is the same for all.
        "connect/endpoints": [end for end in options.connect if end not in options.listen],
        # A teammate that is not there yet is tried again for ever; open() does not wait for it.
        "connect/timeout_ms": -1,
        "connect/exit_on_failure": False,
        "connect/retry": {
            "period_init_ms": 100,
            "period_max_ms": 1000,
            "period_increase_factor": 2,
        },
        # Nor does it wait for teammates that others tell of: wait_for_team does.
        "open/return_conditions": {"connect_scouted": False, "declares": False},
        "scouting/multicast/enabled": options.multicast,
        "scouting/gossip/enabled": True,
        "adminspace/enabled": False,
        "transport/shared_memory/enabled": False,
        "transport/link/protocols": [options.scheme],
        "transport/link/tx/lease": max(1, round(1000 * options.lease_s)),
        # A put to a frozen robot waits no longer than until that robot counts as gone (zenoh: 5 s).
        "transport/link/tx/queue/congestion_control/block/wait_before_close": max(
            1, round(1e6 * options.lease_s)
        ),
        "transport/link/rx/max_message_size": options.largest_message_bytes + FRAME_BYTES,
    }
    if options.secure:
        ca, certificate, key = (str(path) for path in options.own_files(robot))
        settings["transport/link/tls"] = {
            "root_ca_certificate": ca,
            "listen_certificate": certificate,
            "listen_private_key": key,
            "connect_certificate": certificate,
            "connect_private_key": key,
            "enable_mtls": True,
            # Who it is is decided by its common name, not by its address, which may change.
            "verify_name_on_connect": False,
        }
        settings["access_control"] = access_control(robot, robots, options)
    return settings


def access_control(robot: str, robots: Sequence[str], options: NetworkOptions) -> dict[str, Any]:
    """Who may write and hear what, as one robot enforces it.

    Args:
        robot: Who enforces.
        robots: All names, in the order of the team.
        options: The network.

    Returns:
        Zenoh's table ``access_control``.
    """
    prefix = key_prefix(options)
    rules, subjects, policies = [], [], []
    for number, other in enumerate(robots):
        if other == robot:
            continue
        allowed = {
            "write": ("ingress", ["put", "liveliness_token"], [f"{prefix}/{other}/**"]),
            "hear": ("ingress", ["declare_subscriber"], [f"{prefix}/*/to/{other}"]),
            "watch": (
                "ingress",
                ["declare_liveliness_subscriber", "liveliness_query"],
                [f"{prefix}/*/alive/*"],
            ),
            "own": ("egress", list(_ALL_MESSAGES), [f"{prefix}/**"]),
        }
        for name, (flow, messages, keys) in allowed.items():
            rules.append(
                {
                    "id": f"{name}-{number}",
                    "permission": "allow",
                    "flows": [flow],
                    "messages": messages,
                    "key_exprs": keys,
                }
            )
        subjects.append({"id": f"robot-{number}", "cert_common_names": [other]})
        policies.append(
            {
                "id": f"policy-{number}",
                "rules": [f"{name}-{number}" for name in allowed],
                "subjects": [f"robot-{number}"],
            }
        )
    return {
        "enabled": True,
        "default_permission": "deny",
        "rules": rules,
        "subjects": subjects,
        "policies": policies,
    }


def key_prefix(options: NetworkOptions) -> str:
    """First part of every key of a team."""
    return f"fgplan/{options.name}"
