"""Who is asking."""

from types import SimpleNamespace

import pytest

from app.page.visitors.visitors import address_of


@pytest.mark.parametrize(
    ("host", "address"),
    [
        ("192.168.1.7", "192.168.1.7"),
        ("::ffff:192.168.1.7", "192.168.1.7"),
        ("2001:db8:1:2:aaaa::1", "2001:db8:1:2::/64"),
        ("2001:db8:1:2:bbbb::2", "2001:db8:1:2::/64"),
        ("2001:db8:1:3::1", "2001:db8:1:3::/64"),
        ("a socket", "a socket"),
    ],
)
def test_who_has_a_network_is_one_address(host: str, address: str) -> None:
    asked = SimpleNamespace(client=SimpleNamespace(host=host))
    assert address_of(asked) == address  # type: ignore[arg-type]


def test_a_caller_within_the_program_has_no_address() -> None:
    assert address_of(SimpleNamespace(client=None)) == ""  # type: ignore[arg-type]
