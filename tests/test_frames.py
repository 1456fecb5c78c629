"""Frame formats: fixtures written by hand, round trips, and parsers that survive anything."""

import itertools
import math
import random
import tracemalloc

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from suas_jax.acquisition.frames.formats.cobs import stuffed
from suas_jax.acquisition.frames.reading import Reading, crc16
from suas_jax.acquisition.frames.registry import ENCODERS, FORMATS, decoder
from suas_jax.acquisition.ports.can_bus import RECORD

EXAMPLE = Reading(258, 1.5, 3, (13675, 0, 65535))
# Written byte by byte from docs/firmware_frames.md, not by the encoder.
COBS_EXAMPLE = bytes.fromhex(
    "00 04 010303 03 0201 01 04 60E316 03 6B35 01 05 FFFF E7ED 00".replace(" ", "")
)
TEXT_EXAMPLE = b"258,1.500000,3,13675,0,65535\n"
CHECKED_EXAMPLE = b"258,1.500000,3,13675,0,65535*D375\n"
# Two CAN messages of module 3: high bytes 53, 0 and 255 turned round, no other taxels.
SLCAN_EXAMPLE = b"t303840CAFF00FFFFFF80\rt3038C0FFFFFF80FF0000\r"
WIRES = {
    "cobs": COBS_EXAMPLE,
    "jsonl": b'{"seq":258,"t":1.500000,"module":3,"so":[13675,0,65535]}\n',
    "roboskin": SLCAN_EXAMPLE,
    "text": TEXT_EXAMPLE,
    "text-checked": CHECKED_EXAMPLE,
}


def format_of(encoder: str) -> str:
    """The format that a variant belongs to."""
    return next(name for name, known in FORMATS.items() if encoder in known.encoders)


def decoded(name: str, *chunks: bytes) -> list[Reading]:
    decode = decoder(name)
    readings = [r for chunk in chunks for r in decode.feed(chunk, 2.0)] + decode.finish()
    return [r._replace(t_host=math.nan) for r in readings]


def same(a: Reading, b: Reading) -> bool:
    return a[:4] == b[:4] or (
        math.isnan(a.t_device) and math.isnan(b.t_device) and (a[0], *a[2:4]) == (b[0], *b[2:4])
    )


def test_every_format_has_an_example():
    assert set(WIRES) == set(ENCODERS)


@pytest.mark.parametrize("encoder", list(WIRES))
def test_encoder_writes_the_hand_written_example(encoder):
    assert ENCODERS[encoder](EXAMPLE) == WIRES[encoder]


@pytest.mark.parametrize("encoder", [name for name in WIRES if name != "roboskin"])
def test_decoder_reads_the_hand_written_example(encoder):
    (reading,) = decoded(format_of(encoder), WIRES[encoder])
    assert same(reading, EXAMPLE)


@settings(max_examples=30, deadline=None)
@given(data=st.data())
@pytest.mark.parametrize("encoder", [name for name in WIRES if name != "roboskin"])
def test_frames_round_trip_however_they_are_cut(encoder, data):
    frames = data.draw(st.lists(st.integers(0, 65535), min_size=2, max_size=9))
    cut = data.draw(st.integers(1, 40))
    sent = [Reading(i, 0.01 * i, i % 2, (c, 7)) for i, c in enumerate(frames)]
    wire = b"".join(map(ENCODERS[encoder], sent))
    back = decoded(format_of(encoder), *(wire[i : i + cut] for i in range(0, len(wire), cut)))
    assert [r[:4] for r in back] == [(r[0], pytest.approx(r[1]), *r[2:4]) for r in sent]


def test_roboskin_example():
    """Board 1, triangle 5: taxels 0 to 9 in channels 0-5, 7-9, 11; temperature in 6 and 10."""
    first = bytes.fromhex("40 FA F9 F8 F7 F6 F5 80".replace(" ", ""))
    second = bytes.fromhex("C0 F4 F3 F2 81 F1 00 00".replace(" ", ""))
    other = RECORD.pack(0x215, 9.0, 8, first)  # another kind of message
    stream = other + RECORD.pack(0x315, 10.0, 8, first) + RECORD.pack(0x315, 10.5, 8, second)
    stream += RECORD.pack(0x315, 11.0, 8, second)  # a second without its first
    stream += RECORD.pack(0x315, 11.5, 8, first) + RECORD.pack(0x315, 12.0, 8, second)
    decode = decoder("roboskin")
    one, two = decode.feed(stream, 0.0)
    assert one.module == 0x15
    assert one.counts == (0xFA, 0xF9, 0xF8, 0xF7, 0xF6, 0xF5, 0xF4, 0xF3, 0xF2, 0xF1)
    assert one.extra == (0x80, 0x81)
    assert (one.seq, two.seq) == (0, 1)
    assert (one.t_device, two.t_device) == (0.0, 1.5)
    assert decode.tally.malformed == 1


def test_published_check_values():
    assert crc16(b"123456789") == 0x29B1  # the CRC catalogue's check value
    # The examples of Cheshire and Baker's paper and its 254-byte border.
    assert stuffed(b"\0") == b"\1\1"
    assert stuffed(b"\x11\x22\0\x33") == b"\3\x11\x22\2\x33"
    long = bytes(range(1, 255))
    assert stuffed(long) == b"\xff" + long + b"\1"


counts = st.lists(st.one_of(st.none(), st.integers(0, 65535)), min_size=1, max_size=64)
readings = st.builds(
    Reading,
    seq=st.integers(0, 2**32 - 1),
    t_device=st.integers(0, 2**32 - 1).map(lambda us: us / 1e6),
    module=st.integers(0, 255),
    counts=counts.map(tuple),
)


@given(reading=readings, cuts=st.lists(st.integers(0, 600), max_size=5))
def test_cobs_round_trip_however_it_is_cut(reading, cuts):
    wire = ENCODERS["cobs"](reading)
    assert 0 not in wire[1:-1]
    borders = sorted({min(cut, len(wire)) for cut in cuts} | {0, len(wire)})
    chunks = [wire[a:b] for a, b in itertools.pairwise(borders)]
    (back,) = decoded("cobs", *chunks)
    assert same(back, reading)


@given(
    frames=st.lists(
        st.tuples(st.integers(0, 65535), st.integers(0, 65535)), min_size=2, max_size=9
    ),
    encoder=st.sampled_from(["text", "text-checked"]),
    cut=st.integers(1, 40),
    end=st.sampled_from([b"\n", b"\r\n"]),
)
def test_text_round_trip_however_it_is_cut(frames, encoder, cut, end):
    sent = [Reading(i, 0.01 * i, i % 2, c) for i, c in enumerate(frames)]
    wire = b"".join(ENCODERS[encoder](r) for r in sent).replace(b"\n", end)
    back = decoded("text", *(wire[i : i + cut] for i in range(0, len(wire), cut)))
    assert [r[:4] for r in back] == [(r[0], pytest.approx(r[1]), *r[2:4]) for r in sent]


@settings(max_examples=300)
@given(at=st.integers(0, len(COBS_EXAMPLE) - 1), change=st.integers(1, 255))
def test_a_changed_byte_is_always_refused(at, change):
    """CRC-16 detects every burst of up to 16 bits; the neighbours are not touched."""
    before, after = (ENCODERS["cobs"](EXAMPLE._replace(seq=s)) for s in (257, 259))
    wire = bytearray(COBS_EXAMPLE)
    wire[at] ^= change
    decode = decoder("cobs")
    back = decode.feed(before + bytes(wire) + after, 0.0)
    assert [r.seq for r in back] == [257, 259]
    assert decode.tally.bad_crc + decode.tally.malformed >= 1


def test_a_damaged_frame_is_counted_once():
    wire = bytearray(COBS_EXAMPLE)
    wire[-3] ^= 0x40  # of the checksum
    decode = decoder("cobs")
    assert decode.feed(COBS_EXAMPLE + bytes(wire) + COBS_EXAMPLE, 0.0)
    assert (decode.tally.bad_crc, decode.tally.malformed) == (1, 0)


@pytest.mark.parametrize(("taxels", "counts"), [(0, 0), (2, 3), (3, 2), (65, 65)], ids=str)
def test_a_cobs_frame_of_impossible_size_is_refused(taxels, counts):
    """The checksum is right: what is wrong is the number of taxels, or of bytes behind it."""
    body = bytes((1, taxels, 3, 0)) + bytes(8) + counts * b"\x34\x12"
    wire = b"\0" + stuffed(body + crc16(body).to_bytes(2, "little")) + b"\0"
    decode = decoder("cobs")
    assert len(decode.feed(COBS_EXAMPLE + wire + COBS_EXAMPLE, 0.0)) == 2
    assert decode.tally.malformed == 1


def test_the_largest_cobs_frame():
    """64 taxels of which one is missing: nothing longer than this is a frame."""
    largest = Reading(2**32 - 1, (2**32 - 1) / 1e6, 255, (None, *range(1000, 1063)))
    (back,) = decoded("cobs", ENCODERS["cobs"](largest))
    assert same(back, largest)


def test_the_clock_of_cobs_frames_starts_again_after_71_minutes():
    around = 2**32 / 1e6  # seconds
    assert decoder("cobs").clock_modulus == pytest.approx(around, rel=1e-12)
    (back,) = decoded("cobs", ENCODERS["cobs"](EXAMPLE._replace(t_device=around + 1.5)))
    assert same(back, EXAMPLE)


def text_lines(first: int, last: int) -> bytes:
    return b"".join(
        ENCODERS["text"](Reading(i, i / 100, m, (13000 + i, 13500 + m)))
        for i in range(first, last)
        for m in range(2)
    )


@pytest.mark.parametrize(
    "damage",
    [
        b"104,1.04,0,13104\n",  # its tail is missing
        b"104,1.04,0,13104,13500,7\n",
        b"104,1.04,0,131x4,13500\n",
        b"104,1.04,0,13104,99999\n",
        b"104,1.04,0,-3104,13500\n",
        b"104;1.04;0;13104;13500\n",
        b"1.04,0,13104,13500\n",
        b"104,1.04,7,13104,13500\n",  # a module that nobody knows
        b"\xff\xfe\0\n",
        b"," * 400 + b"\n",
        b"9" * 20000 + b"\n",
    ],
)
def test_a_damaged_line_is_refused_and_counted(damage):
    decode = decoder("text")
    back = decode.feed(text_lines(90, 104), 0.0)
    back += decode.feed(damage + text_lines(105, 110), 0.0) + decode.finish()
    assert [r.seq for r in back] == [
        s for s in [*range(90, 104), *range(105, 110)] for _ in "ab"
    ]
    assert decode.tally.malformed == 1


@pytest.mark.parametrize(
    "garbage", [b"\xffgarbage", b"x", b"104,1.04,0,13104,1350", b"999,9.99,1,", b"\0\0\0"]
)
def test_a_whole_line_behind_garbage_is_kept(garbage):
    decode = decoder("text")
    back = decode.feed(text_lines(90, 104), 0.0)
    back += decode.feed(garbage + text_lines(104, 108), 0.0) + decode.finish()
    assert [r.seq for r in back] == [s for s in range(90, 108) for _ in "ab"]
    assert decode.tally.malformed == 1


@pytest.mark.parametrize("lost", range(1, 12))
def test_opened_in_the_middle_of_a_line(lost):
    """The rest of the first line never becomes a frame, however much it looks like one."""
    lines = text_lines(1234, 1240)
    decode = decoder("text")
    back = decode.feed(lines[lost:], 0.0) + decode.finish()
    whole = [(s, m) for s in range(1234, 1240) for m in range(2)]
    assert [(r.seq, r.module) for r in back] == whole[1:]
    assert decode.tally.partial == 1
    assert decode.tally.malformed == 0


def test_opened_in_the_middle_of_the_last_frame_before_a_carry():
    """One module alone: `999,...` is what is left of frame 1999 if frame 2000 follows."""
    lines = b"".join(ENCODERS["text"](Reading(i, 0.0, 0, (5, 7))) for i in range(1999, 2004))
    assert [r.seq for r in decoded("text", lines[1:])] == list(range(2000, 2004))
    assert [r.seq for r in decoded("text", lines)] == list(range(1999, 2004))


def test_frames_are_released_when_every_module_has_spoken_twice():
    rest_of_a_line, *lines = text_lines(1234, 1240).splitlines(keepends=True)
    decode = decoder("text")
    # Cut within the time, it reads as frame 340000 of a module 14234.
    assert decode.feed(rest_of_a_line[8:] + b"".join(lines[:3]), 0.0) == []
    assert [r.seq for r in decode.feed(lines[3], 0.0)] == [1234, 1235, 1235, 1236]
    assert decode.tally.partial == 1


def test_late_modules_are_believed_at_their_second_line():
    decode = decoder("text")
    decode.feed(text_lines(0, 5), 0.0)
    late = [ENCODERS["text"](Reading(5, 0.05, 7, (1,) * width)) for width in (3, 2, 2)]
    assert decode.feed(late[0] + late[1], 0.0) == []
    assert decode.tally.malformed == 1  # the first: its module sends two counts
    assert [len(r.counts) for r in decode.feed(late[2], 0.0)] == [2, 2]
    # Damaged module numbers: 128 are remembered, and each counts once in the end.
    decode.feed(b"".join(b"6,0.06,%d,1,2\n" % k for k in range(1000, 1130)), 0.0)
    assert decode.tally.malformed == 1 + 2
    decode.finish()
    assert decode.tally.malformed == 1 + 130


def test_a_late_module_s_first_line_never_comes_out_behind_later_ones():
    decode = decoder("text")
    decode.feed(text_lines(0, 5), 0.0)
    late = [ENCODERS["text"](Reading(seq, 0.0, 7, (1, 2))) for seq in (5, 6, 7)]
    back = decode.feed(late[0], 1.0) + decode.feed(text_lines(5, 6), 2.0)
    back += decode.feed(late[1] + late[2], 3.0)
    assert [(r.seq, r.t_host) for r in back if r.module == 7] == [(6, 3.0), (7, 3.0)]
    assert decode.tally.malformed == 1


@pytest.mark.parametrize("name", [name for name in ENCODERS if name != "roboskin"])
def test_damaged_streams_come_out_in_the_order_of_their_arrival(name):
    """Flipped bits in 1 of 1000 bytes, of 4 modules: modules that are none, and late ones."""
    rng = random.Random(5)
    taxels = tuple(range(13000, 13010))
    frames = (Reading(k, 0.01 * k, m, taxels) for k in range(1500) for m in range(4))
    data = bytearray(b"".join(map(ENCODERS[name], frames)))
    for _ in range(len(data) // 1000):
        data[rng.randrange(len(data))] ^= 1 << rng.randrange(8)
    decode = decoder(format_of(name))
    chunks = range(0, len(data), 64)
    back = [r for at in chunks for r in decode.feed(bytes(data[at : at + 64]), 1e-4 * at)]
    back += decode.finish()
    assert len(back) > 4500
    assert [r.t_host for r in back] == sorted(r.t_host for r in back)


def test_a_clock_of_any_length_is_read_or_refused():
    lines = [b'{"seq":1,"t":1%s,"module":0,"so":[5]}\n' % (b"0" * n) for n in (3, 400, 5000)]
    assert [r.t_device for r in decoded("jsonl", *lines)] == [1000.0]


@pytest.mark.parametrize("chunk", [700, 9000])
def test_an_endless_line_is_one_damaged_line(chunk):
    decode = decoder("text")
    noise = b"9" * 20000
    back = decode.feed(text_lines(0, 5), 0.0)
    for at in range(0, len(noise), chunk):
        back += decode.feed(noise[at : at + chunk], 0.0)
    back += decode.feed(b"\n" + text_lines(5, 10), 0.0)
    assert [r.seq for r in back] == [s for s in range(10) for _ in "ab"]
    assert decode.tally.malformed == 1
    assert decode.tally.discarded == len(noise) + 1


def test_remarks_blank_lines_and_missing_values():
    lines = (
        b"# firmware 1.2\r\nseq,t_device_s,module,so_1,so_2\r\n\r\n 1, ,0, 5,\r\n2,,0,nan,6\r\n"
    )
    decode = decoder("text")
    back = decode.feed(lines, 0.0)
    assert [r.counts for r in back] == [(5, None), (None, 6)]
    assert all(math.isnan(r.t_device) for r in back)
    assert decode.tally.malformed == 0


def test_one_frame_and_then_nothing():
    assert [r.seq for r in decoded("text", b"7,0.07,0,1,2\n")] == [7]


def test_checksums_once_seen_are_required():
    lines = b"".join(ENCODERS["text-checked"](EXAMPLE._replace(seq=s)) for s in range(4))
    unchecked = ENCODERS["text"](EXAMPLE._replace(seq=4))
    assert [r.seq for r in decoded("text", lines + unchecked)] == [0, 1, 2, 3]


def test_a_module_that_really_changed_is_believed_again():
    wide = b"".join(ENCODERS["text"](Reading(i, 0.0, 0, (1, 2, 3))) for i in range(5, 40))
    narrow = b"".join(ENCODERS["text"](Reading(i, 0.0, 0, (1, 2))) for i in range(5))
    back = decoded("text", narrow + wide)
    assert len(back[-1].counts) == 3
    assert back[-1].seq == 39


def test_a_module_has_changed_when_twenty_lines_in_a_row_say_so():
    def lines(first: int, last: int, *counts: int) -> bytes:
        return b"".join(
            ENCODERS["text"](Reading(i, 0.0, 0, counts)) for i in range(first, last)
        )

    stream = lines(0, 5, 1, 2) + lines(5, 24, 1, 2, 3) + lines(24, 25, 1, 2)
    stream += lines(25, 45, 1, 2, 3)  # only the last of these is the twentieth in a row
    assert [r.seq for r in decoded("text", stream)] == [0, 1, 2, 3, 4, 24, 44]


def corpus(name: str, rng: random.Random, size: int) -> bytes:
    """Random bytes, and true frames with bytes changed, cut out and doubled."""
    if name == "roboskin":
        true = b"".join(RECORD.pack(0x300 + i % 5, 0.1 * i, 8, b"\x40" * 8) for i in range(50))
    else:
        frames = [EXAMPLE._replace(seq=i) for i in range(50)]
        true = b"".join(ENCODERS[name](frame) for frame in frames)
    parts, total = [], 0
    while total < size:
        part = bytearray(
            rng.randbytes(rng.choice([3, 300, 5000])) if rng.random() < 0.5 else true
        )
        for _ in range(rng.randrange(6)):
            at = rng.randrange(len(part))
            if rng.random() < 0.5:
                part[at] = rng.randrange(256)
            else:
                del part[at : at + rng.randrange(20)]
                part = part or bytearray(b"\0")
        parts.append(bytes(part))
        total += len(part)
    return b"".join(parts)


def fuzz(name: str, seed: int, size: int) -> tuple[int, int]:
    """Feed a decoder; return false readings and the peak of its memory [bytes]."""
    rng = random.Random(seed)
    data = corpus(name, rng, size)
    decode = decoder(name)
    false = 0
    tracemalloc.start()
    at = 0
    while at < len(data):
        step = rng.randrange(1, 5000)
        for reading in decode.feed(data[at : at + step], 0.0):
            assert all(c is None or 0 <= c <= 65535 for c in reading.counts)
            false += reading.counts != EXAMPLE.counts
        at += step
    decode.finish()
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert decode.tally.bytes == len(data)
    return false, peak


@pytest.mark.parametrize("name", list(FORMATS))
def test_fuzz(name):
    """Random bytes and mutilated frames: no crash, bounded memory, no false frame."""
    false, peak = fuzz(name, seed=7, size=300_000)
    assert peak < 2_000_000
    if name == "cobs":
        assert false == 0  # the chance is below 1e-2 for this corpus


@settings(max_examples=150)
@given(
    name=st.sampled_from(list(FORMATS)),
    chunks=st.lists(
        st.one_of(
            st.binary(max_size=80), st.sampled_from([*WIRES.values(), b"\0", b"\n", b"1,"])
        ),
        max_size=30,
    ),
)
def test_no_bytes_break_a_decoder(name, chunks):
    decode = decoder(name)
    for chunk in chunks:
        decode.feed(chunk, 0.0)
    decode.finish()
    assert decode.tally.bytes == sum(map(len, chunks))
    (back,) = decode.feed(COBS_EXAMPLE, 0.0) if name == "cobs" else [EXAMPLE]
    assert same(back, EXAMPLE)
