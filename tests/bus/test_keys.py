from yahboomd.core.bus import keys
from yahboomd.core.names import name_problem


def test_namespace_goes_in_front_of_every_key():
    assert keys.full_key("bot1", keys.POSE) == "bot1/yahboomd/pose"
    assert keys.full_key("site/bot1", keys.CMD_VEL) == "site/bot1/cmd_vel"


def test_without_a_namespace_a_key_is_itself():
    assert keys.full_key("", keys.ESTOP) == "yahboomd/estop"


def test_a_key_with_a_leading_slash_is_outside_the_namespace():
    assert keys.full_key("bot1", "/0/odom/x") == "0/odom/x"


def test_a_persons_key_of_a_service_has_the_name_in_it():
    assert keys.own_key(keys.ESTOP_RESET, "anna") == "yahboomd/estop/reset/by/anna"


def test_every_key_is_a_name():
    named = [value for name, value in vars(keys).items() if name.isupper() and name[0] != "_"]
    names = [value for value in named if isinstance(value, str)]
    assert names
    assert [name for name in names if name_problem(name)] == []
    assert len(set(names)) == len(names)


def test_holder_of_a_token_is_read_back():
    assert (
        keys.holder_of("bot1/yahboomd/alive", keys.holder_key("bot1/yahboomd/alive", "ab")) == "ab"
    )
    assert keys.holder_of("bot1/yahboomd/alive", "bot1/yahboomd/alive") is None
    assert keys.holder_of("bot1/yahboomd/alive", "bot2/yahboomd/alive/ab") is None
    assert keys.holder_of("bot1/yahboomd/alive", "bot1/yahboomd/alive/ab/cd") is None
