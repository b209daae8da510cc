"""Answers each message of a JetStream stream exactly once: `wayfix-fleet live` between two streams.

    pip install nats-py
    python bridge.py --input seen --output positions --subject positions.all --folder state \
        -- wayfix-fleet live --model model.json --every 10

Messages of the stream `seen` are lines without an `offset`. Their answers go to the stream
`positions`, which has no other writer. Each run continues where the last one was, however that ended;
restart it when it ends with an error, as systemd does with `Restart=always`.

Nothing is lost or duplicated, for three reasons:
- The service reports the sequence number at which its snapshot ends, and is given the messages after it.
- Its file of answers is the same to the byte as if it had never been killed.
- Each published answer carries the position in this file at which it ends, and is published on the
  condition that it follows the last one. So the stream itself tells what comes next, and refuses anything else.
"""

import argparse
import asyncio
import contextlib
import json
import os
import pathlib
import signal
import sys

import nats
from nats.js.api import AckPolicy, ConsumerConfig, DeliverPolicy

PLACE = "Wayfix-Place"
EXPECTED = "Nats-Expected-Last-Sequence"
PART = 1 << 16


async def begin(command, folder):
    """Starts the service. Returns it, and the sequence number of the last message that it has taken."""
    snapshot = folder / "pool.bin"
    service = await asyncio.create_subprocess_exec(
        *command, "--restore", snapshot, "--snapshot", snapshot,
        "--output", folder / "answers.jsonl", "--log", "json",
        stdin=asyncio.subprocess.PIPE, stderr=asyncio.subprocess.PIPE)
    while line := await service.stderr.readline():
        # Not read from the snapshot: a service whose bridge was killed may still have to write it.
        if line.startswith(b"{") and (event := json.loads(line))["event"] == "begin":
            return service, event["offset"] or 0
        sys.stderr.buffer.write(line)
    sys.exit("the service did not start")


async def log(service):
    while line := await service.stderr.readline():
        sys.stderr.buffer.write(line)
        sys.stderr.flush()


async def feed(stream, name, service, last):
    """Passes all messages after `last` to the service."""
    config = ConsumerConfig(
        deliver_policy=DeliverPolicy.BY_START_SEQUENCE, opt_start_seq=last + 1, ack_policy=AckPolicy.NONE)
    messages = await stream.pull_subscribe(">", stream=name, config=config)
    delivered = 0
    while True:
        try:
            batch = await messages.fetch(1000, timeout=5)
        except nats.errors.TimeoutError:
            continue
        for message in batch:
            sequence, delivered = message.metadata.sequence, delivered + 1
            if sequence.consumer != delivered:
                raise RuntimeError("a message was lost on the way")
            # In JSON, line breaks can only be between tokens. Anything else is answered as a bad line.
            line = message.data.strip()[1:].replace(b"\n", b" ")
            service.stdin.write(b'{"offset":%d,' % sequence.stream + line + b"\n")
        await service.stdin.drain()


async def publish(stream, options, path, is_over):
    """Publishes the answers from the file, until the run is over."""
    info = await stream.stream_info(options.output)
    sequence, place = info.state.last_seq, 0
    if sequence > 0:
        place = int((await stream.get_msg(options.output, sequence)).headers[PLACE])
    file, freed = None, place
    while True:
        was_over = is_over.is_set()
        # A file that was cut back to its snapshot may still be shorter than `place`.
        if file is None and path.exists():
            file = path.open("rb")
        lines = []
        if file is not None and path.stat().st_size > place:
            file.seek(place)
            lines = file.readlines(PART)
        acks = []
        for line in lines:
            if not line.endswith(b"\n"):
                break
            place += len(line)
            headers = {PLACE: str(place), EXPECTED: str(sequence)}
            acks.append(await stream.publish_async(options.subject, line[:-1], headers=headers))
            sequence += 1
        await asyncio.wait_for(asyncio.gather(*acks), 30)
        if place - freed >= options.free:
            # Frees the disk space without changing the length of the file. Not all systems can do this.
            with contextlib.suppress(FileNotFoundError):
                await asyncio.create_subprocess_exec(
                    "fallocate", "--punch-hole", "--offset", "0", "--length", str(place), path)
            freed = place
        if not acks:
            if was_over:
                return
            await asyncio.sleep(0.005)


async def main():
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--server", default="nats://127.0.0.1:4222")
    parser.add_argument("--input", required=True, help="stream of the lines")
    parser.add_argument("--output", required=True, help="stream of the answers")
    parser.add_argument("--subject", required=True, help="subject of the answers")
    parser.add_argument("--folder", required=True, type=pathlib.Path, help="folder of the snapshot and the answers")
    parser.add_argument("--free", type=int, default=1 << 26, help="bytes of answers after which disk space is freed")
    parser.add_argument("command", nargs="+", help="wayfix-fleet live, with its options")
    options = parser.parse_args()
    client = await nats.connect(options.server)
    stream = client.jetstream(publish_async_max_pending=20_000)
    service, last = await begin(options.command, options.folder)
    is_over = asyncio.Event()
    stop = asyncio.Event()
    for name in (signal.SIGTERM, signal.SIGINT):
        asyncio.get_running_loop().add_signal_handler(name, stop.set)
    feeding = asyncio.create_task(feed(stream, options.input, service, last))
    path = options.folder / "answers.jsonl"
    publishing = asyncio.create_task(publish(stream, options, path, is_over))
    logging = asyncio.create_task(log(service))
    stopped = asyncio.create_task(stop.wait())
    ended = asyncio.create_task(service.wait())
    done, _ = await asyncio.wait(
        {feeding, publishing, stopped, ended}, return_when=asyncio.FIRST_COMPLETED)
    feeding.cancel()
    if done != {stopped}:
        # Left as after a kill: the next run continues.
        for task in done & {feeding, publishing}:
            print(f"bridge: {task.exception()!r}", file=sys.stderr)
        with contextlib.suppress(ProcessLookupError):
            service.kill()
        os._exit(1)
    # The service answers what it has received, and writes its snapshot.
    service.stdin.close()
    await ended
    is_over.set()
    await publishing
    await logging
    await client.close()


if __name__ == "__main__":
    asyncio.run(main())
