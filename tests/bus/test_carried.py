import pytest
import zenoh
from zenoh_fixtures import eventually

from yahboomd.bus.carried import carried_bytes

pytestmark = pytest.mark.realtime


async def test_payload_and_attachment_are_counted_together(bus, zenoh_app):
    carriers = []
    bus.session.declare_subscriber("x", carriers.append)
    bus.session.declare_queryable("x", carriers.append)
    session = zenoh_app("client", bus.options.listen[0]).session
    block = {"congestion_control": zenoh.CongestionControl.BLOCK}
    session.put("x", b"12345", **block)
    session.put("x", b"12345", attachment=b"123", **block)
    session.delete("x", **block)
    await eventually(lambda: len(carriers) == 3)
    session.get("x", print)
    session.get("x", print, payload=b"12", attachment=b"1")
    await eventually(lambda: len(carriers) == 5)
    assert [carried_bytes(each) for each in carriers] == [5, 8, 0, 0, 3]
    for query in carriers[3:]:
        query.drop()
