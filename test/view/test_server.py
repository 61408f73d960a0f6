"""The server: what it tells, what it takes, and from whom."""

from __future__ import annotations

import asyncio
import json
import re

import aiohttp
import pytest
from serving import serving

from gda_tracker.view.conversation import Conversation, Encoder, RequestError, read_request
from gda_tracker.view.history import History
from gda_tracker.view.player import Player

TIMEOUT_S = 20.0
LOOK = {"want": None, "have": None, "track": None, "past": 10, "fresh": True}


@pytest.fixture
def player(gda):
    made = Player(gda.play, gda.parameters, History(), rate=0.0, playing=False)
    made.start()
    yield made
    made.close()


def talk(player, conversation, **options):
    """Run a conversation with a server of the player."""

    async def run(address):
        async with asyncio.timeout(TIMEOUT_S), aiohttp.ClientSession(address) as session:
            return await conversation(session)

    with serving(player, **options) as address:
        return asyncio.run(run(address))


async def status_of(session, method, path, **options):
    async with session.request(method, path, **options) as answer:
        return answer.status, await answer.text()


def test_the_page_and_everything_it_needs_comes_from_here(player):
    async def conversation(session):
        _, page = await status_of(session, "GET", "/")
        assert "http://" not in page
        assert "https://" not in page
        needed = re.findall(r'(?:src|href)="([^"]+)"', page)
        assert len(needed) >= 5
        for path in (*needed, "/library/plotly.min.js"):
            status, text = await status_of(session, "GET", path)
            assert (status, bool(text)) == (200, True)
        async with session.get("/") as answer:
            assert "default-src 'self'" in answer.headers["Content-Security-Policy"]
        assert (await status_of(session, "GET", "/static/../server.py"))[0] == 404

    talk(player, conversation)


def test_pages_of_other_sites_are_refused(player):
    async def conversation(session):
        change = {"json": {"node": "track_manager", "values": {"gate_probability": 0.5}}}
        evil = {"Origin": "http://evil.example"}
        for path in ("/api/parameters", "/api/control"):
            status, text = await status_of(session, "POST", path, headers=evil, **change)
            assert (status, "origin" in text) == (403, True)
        status, _ = await status_of(session, "GET", "/live", headers=evil)
        assert status == 403
        # A name of somebody else's that was made to point here.
        rebound = {"Host": "evil.example:80"}
        assert (await status_of(session, "GET", "/api/parameters", headers=rebound))[0] == 403
        # What a form can send without asking first.
        plain = {"Content-Type": "text/plain"}
        body = json.dumps(change["json"])
        status, _ = await status_of(session, "POST", "/api/parameters", data=body, headers=plain)
        assert status == 415
        return player.values()["track_manager"]["gate_probability"]

    assert talk(player, conversation) == 0.99


def test_read_only_means_read_only(player):
    async def conversation(session):
        told = await (await session.get("/api/parameters")).json()
        assert told["allow_changes"] is False
        for path, content in (
            ("/api/parameters", {"node": "track_manager", "values": {"gate_probability": 0.5}}),
            ("/api/control", {"command": "play"}),
        ):
            status, text = await status_of(session, "POST", path, json=content)
            assert (status, "--allow-changes" in text) == (403, True)

    talk(player, conversation, allow_changes=False)
    assert player.values()["track_manager"]["gate_probability"] == 0.99
    assert player.history.newest == 0


def test_changes_are_answered_with_scan_or_reason(player):
    async def change(session, node, **values):
        content = {"node": node, "values": values}
        return await (await session.post("/api/parameters", json=content)).json()

    async def conversation(session):
        # As typed, and as numbers.
        good = await change(session, "track_manager", gate_probability="0.9")
        assert good == {"accepted": True, "reason": "", "acts_from_scan": 1}
        assert (await change(session, "track_manager", clutter_density_per_m_rad="1e-7"))[
            "accepted"
        ]
        assert (await change(session, "track_manager", decision="map"))["accepted"]
        for node, values, reason in (
            ("track_manager", {"gate_probability": "2"}, "allowed is a number > 0"),
            ("track_manager", {"gate_probability": "wide"}, "'wide': allowed is a number"),
            ("track_manager", {"decision": "guess"}, "one of gda, map, jpda, mht"),
            ("track_manager", {"gait": 1}, "parameter gait: unknown"),
            ("track_manager", {"tracking_frame": "odom"}, "fixed at start-up"),
            ("nobody", {"x": 1}, "node nobody: unknown"),
        ):
            bad = await change(session, node, **values)
            assert bad["accepted"] is False
            assert reason in bad["reason"]
        listed = {
            (p["node"], p["name"]): p
            for p in (await (await session.get("/api/parameters")).json())["parameters"]
        }
        assert listed["track_manager", "gate_probability"]["value"] == 0.9
        assert listed["track_manager", "tracking_frame"]["live"] is False
        for text in ("{", "[]", '{"node": "track_manager"}'):
            headers = {"Content-Type": "application/json"}
            status, _ = await status_of(
                session, "POST", "/api/parameters", data=text, headers=headers
            )
            assert status == 400
        notices = [notice.text for notice in player.history.notices()]
        assert "track_manager: gate_probability = 0.9: accepted" in notices
        assert any("refused: parameter gate_probability = 2" in text for text in notices)

    talk(player, conversation)


def test_commands_steer_the_replay(player, gda):
    async def command(session, **content):
        return await status_of(session, "POST", "/api/control", json=content)

    async def conversation(session):
        async with session.ws_connect("/live") as live:
            await live.send_json(LOOK)
            first = await live.receive_json()
            assert "scan" not in first
            assert first["status"]["playing"] is False
            await live.send_json({**LOOK, "fresh": False})
            assert (await command(session, command="step"))[0] == 200
            while "scan" not in (told := await live.receive_json()):
                await live.send_json({**LOOK, "fresh": False})
            assert told["scan"]["number"] == 1
            assert told["matrix"]["rows"]["track"]
            assert (await command(session, command="rate", value=3))[0] == 200
            assert player.status()["rate"] == 3.0
            assert (await command(session, command="rate", value="fast"))[0] == 400
            assert (await command(session, command="dance"))[0] == 400

    talk(player, conversation)


def test_a_browser_that_draws_slowly_skips_scans_and_gets_the_past_of_them(player, gda):
    """It asks when it has drawn; what came meanwhile comes as past, the newest as the scan."""
    total = len(gda.results)

    async def conversation(session):
        track = int(gda.results[0].tracks.track_id[0])
        async with session.ws_connect("/live") as live:
            player.play()
            while not player.finished or player.history.newest < total:
                await asyncio.sleep(0.01)
            await live.send_json({**LOOK, "have": total - 4, "track": track})
            told = await live.receive_json()
            assert told["scan"]["number"] == total
            assert [scan["number"] for scan in told["past"]] == list(range(total - 3, total))
            assert told["track"]["id"] == track
            # Looking back.
            await live.send_json({**LOOK, "want": 3})
            told = await live.receive_json()
            assert told["scan"]["number"] == 3
            assert [scan["number"] for scan in told["past"]] == [1, 2]

    talk(player, conversation)


def test_a_request_that_is_not_well_formed_ends_the_conversation(player):
    async def conversation(session):
        async with session.ws_connect("/live") as live:
            await live.send_str('{"want": "all"}')
            message = await live.receive()
            assert message.type == aiohttp.WSMsgType.CLOSE
            assert "want = 'all'" in message.extra

    talk(player, conversation)


@pytest.mark.parametrize(
    "text", ["", "[1]", '{"want": true}', '{"past": -1}', '{"past": 1e9}', '{"track": "1"}']
)
def test_requests_are_checked(text):
    with pytest.raises(RequestError):
        read_request(text)


def test_who_never_reads_holds_nobody_up(gda):
    """Sending to one hangs; the player goes on, the other is served, and nothing piles up."""
    pictures = [picture for _, picture in gda.history.between(1, 999)]

    async def run():
        history = History()
        encoder = Encoder(history, dict)
        stuck, sent = asyncio.Event(), []

        async def hang(_):
            await stuck.wait()

        async def take(text):
            sent.append(json.loads(text))

        bad, good = Conversation(encoder, history, hang), Conversation(encoder, history, take)
        tasks = [asyncio.ensure_future(c.run()) for c in (bad, good)]
        for picture in pictures:
            for conversation in (bad, good):
                conversation.ask(json.dumps({**LOOK, "fresh": False}))
            history.add(picture)
            for conversation in (bad, good):
                conversation.changed()
            await asyncio.sleep(0.04)
        for task in tasks:
            task.cancel()
        return sent

    sent = asyncio.run(run())
    assert sent[-1]["scan"]["number"] == len(pictures)
    assert len(sent) >= len(pictures) // 2
