"""Frames of a video file, as a player shows them: upright, with square pixels, at their times."""

import contextlib
import functools
import itertools
import math
import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import av
import cv2
import numpy as np
from av.container import InputContainer
from av.stream import Disposition
from av.video.reformatter import VideoReformatter

from geovp_classic import files
from geovp_classic.data.frames.image_frames import MAX_PIXELS, file_digest, oriented
from geovp_classic.errors import BadData
from geovp_classic.types import ByteArray, FloatArray, IntArray

NO_TIMESTAMPS = 0x80  # AVFMT_NOTIMESTAMPS: raw streams, for which FFmpeg invents a rate
MPEG4_FRAME = b"\0\0\1\xb6"  # start code of a video object plane
CACHE_BYTES = 256 * files.MIB
MIN_STEP_S = 1e-4  # cameras take up to some thousand frames per second; headers may state more


class VideoFrames:
    """The frames that the decoder delivers, in the order in which they are presented.

    Neither the frame count, the rate nor the duration of the container is used. The packets tell
    when each frame is presented. Frames do not count if an edit list hides them, or if they cannot
    be decoded because the file begins inside a group of pictures or ends inside a packet, or if
    nothing states their time, as of the last ones of an AVI file with B-frames. A byte
    that changed inside a packet is noticed only where the codec allows it; VP8 and FFV1 do not.
    `times_s` [N] are seconds since the first frame, None for a raw stream.
    """

    def __init__(self, path: Path) -> None:
        """Open a video file and list its frames; BadData if it cannot be decoded."""
        with files.opened(path):
            self.path = path
        what = f"{path} cannot be decoded as a video of at most {MAX_PIXELS:,} pixels"
        with files.checked(what, "give a folder of images or another video file"):
            self._number = self._choose_stream()
            self._restart()
            self._list_frames()
            self._shown_from_stored = display_matrix(self._first).tolist()
            height_px, width_px = self._picture(self._first).shape[:2]
        self.size_px = width_px, height_px
        num_cached = CACHE_BYTES // (3 * width_px * height_px)
        self.read = functools.lru_cache(maxsize=max(2, min(64, num_cached)))(self._decode)

    def __len__(self) -> int:
        return len(self._ticks)

    def digest(self, index: int) -> bytes:
        """Return a hash of the content of a frame, from a part of the video's file."""
        return file_digest(self.path) + str(index).encode()

    @property
    def names(self) -> tuple[Path, ...]:
        """Return a name for each frame; no files have these names."""
        return tuple(self.path / f"frame {number}" for number in range(len(self)))

    def times_at(self, stated_hz: float | None, name: str = "frame_rate_hz") -> FloatArray:
        """Return the times of all frames; a stated rate must be that of the video.

        BadData if the rates differ by more than 5 %, or if there is none; it calls the stated one
        `name`.
        """
        if self.times_s is None:
            if stated_hz is None:
                raise BadData(
                    f"{self.path} does not state its rate: give frame_rate_hz, or fps in the file "
                    "of cameras"
                )
            return np.arange(len(self)) / stated_hz
        if stated_hz is not None and len(self) > 1:
            usual_hz = 1 / float(np.median(np.diff(self.times_s)))
            mean_hz = (len(self) - 1) / self.times_s[-1]
            if min(abs(np.log(stated_hz / rate_hz)) for rate_hz in (usual_hz, mean_hz)) > 0.05:
                raise BadData(
                    f"{self.path} has {usual_hz:.4g} frames per second, {name} is "
                    f"{stated_hz:g}: leave it out, because wrong times give wrong speeds; rate_hz "
                    f"= {stated_hz:g} uses about that many frames of each second"
                )
        return self.times_s

    def _open(self) -> InputContainer:
        """Open the file."""
        # "file:" keeps a colon in a name from being a protocol; a playlist opens nothing else.
        return av.open(
            f"file:{self.path.absolute()}",
            options={"protocol_whitelist": "file"},
            metadata_errors="ignore",
        )

    def _choose_stream(self) -> int:
        """Return the number of the largest stream, but of no cover and no thumbnail.

        Cameras write small previews beside it, which may be the default or the first. Of equal
        ones, it is the one that players show.
        """
        container = self._open()
        best = container.streams.best("video")
        numbers = [
            each.index
            for each in sorted(
                container.streams.video,
                key=lambda each: (-each.width * each.height, each != best),
            )
            if not each.disposition & Disposition.attached_pic
        ]
        if not numbers:
            raise ValueError("it has no video stream")
        for number in numbers:
            first_packets = itertools.islice(_packets(container, number), 2)
            if all(packet.size for packet in first_packets):  # the end of the file is empty
                return number
            container = self._open()
        return numbers[0]

    def _restart(self) -> None:
        """Decode from the beginning of the file."""
        self._container = self._open()
        stream: Any = self._container.streams[self._number]
        if stream.codec_context.name == "ansi":  # FFmpeg draws .txt files on a terminal
            raise ValueError("it is text")
        self._stream = stream
        aspect = self._stream.sample_aspect_ratio or 1
        num_pixels = stream.width * stream.height * max(aspect, 1 / aspect)  # as it is shown
        if not 0 < num_pixels <= MAX_PIXELS:
            raise ValueError(
                f"its frames have {stream.width}x{stream.height} pixels of aspect {aspect}"
            )
        self._decoder = stream.codec_context
        # FFmpeg's own decoder does not notice damage; libvpx is built without 10 and 12 bits
        if self._decoder.name == "vp9" and self._decoder.profile in ("Profile 0", "Profile 1"):
            self._decoder = av.CodecContext.create("libvpx-vp9", "r")
            self._decoder.extradata = stream.codec_context.extradata
        self._decoder.thread_type = "AUTO"
        self._decoder.options = {"err_detect": "crccheck+explode"}
        self._reformatter = VideoReformatter()
        self._continue()

    def _continue(self) -> None:
        """Decode from here on."""
        self._decoded = self._decode_on()
        self._last_tick = -math.inf  # of the newest decoded frame

    def _decode_on(self) -> Iterator[tuple[int, Any]]:
        """Yield ticks and frames from here on, without frames that are damaged."""
        number = itertools.count()
        is_damaged = False  # up to the next key frame, because frames build on earlier ones
        for packet in _packets(self._container, self._number):
            decoded = []
            try:
                decoded = self._decoder.decode(packet if packet.size else None)
            except av.FFmpegError:
                is_damaged = True
            for frame in decoded:
                tick = next(number) if self._is_counted else frame.pts
                is_damaged = frame.is_corrupt or (is_damaged and not frame.key_frame)
                if tick is not None and not is_damaged:
                    yield tick, frame

    def _list_frames(self) -> None:
        """List the ticks of frames [N] and of key frames, in units of the time base.

        The first frame and the last group of pictures are decoded, or all frames if packets do not
        tell.
        """
        whole = self._read_packets()
        self._restart()
        start, first = next(self._decoded, (0, None))
        if first is None:
            raise ValueError("no frame can be decoded")
        self._first = first
        last_key = self._keys[-1] if self._keys else start
        self._seek(last_key)
        decoded = self._decode_rest()
        if last_key not in decoded:  # the index led to later frames, or the file ends inside it
            last_key = start
            self._restart()
            decoded = self._decode_rest()
        if self._is_counted:
            whole = [
                tick for tick, stamp in decoded.items() if self._has_times or stamp is not None
            ]
        ticks = [tick for tick in whole if start <= tick < last_key or tick in decoded]
        if not ticks:
            raise ValueError("no whole frame can be decoded")
        self._ticks: IntArray = np.unique(ticks)  # of frames with one time, a player shows one

        stamps = self._ticks.tolist()
        if self._is_counted:
            stamps = [decoded[tick] for tick in stamps]
        self.times_s = None if self._is_raw else self._times(stamps)

    def _read_packets(self) -> list[int]:
        """Return the ticks of frames by the packets, and find out what ticks and times are.

        Ticks are numbers, and all frames must be decoded, in a raw stream, which has no times, in
        AVI files and in MPEG-4 with packets of several frames or none, which have those of
        decoding, and where times begin again, because several recordings were put together.
        """
        is_irregular = False  # in MPEG-4
        whole: list[int] = []
        keys: list[int] = []
        order: list[int] = []
        places: list[tuple[int, int]] = []
        for packet in _packets(self._container, self._number):
            if packet.is_keyframe and packet.pts is not None:
                keys.append(packet.pts)
            if packet.dts is not None:
                order.append(packet.dts)
                places.append((packet.dts, packet.pos))
            if not packet.size or packet.is_discard or packet.is_corrupt:
                continue
            if self._decoder.name == "mpeg4":
                count = bytes(packet).count(MPEG4_FRAME)
                # a plane without pixels has up to 19 bytes (MAX_NVOP_SIZE of FFmpeg)
                is_irregular |= count > 1 or packet.size < 20
            # A bit of VP8 says whether a frame is shown, or only serves others (RFC 6386, 9.1)
            if self._decoder.name != "vp8" or memoryview(packet)[0] & 0x10:
                whole.append(packet.pts)
        self._is_raw = bool(int(self._container.format.flags) & NO_TIMESTAMPS)
        is_avi = self._container.format.name == "avi"
        self._has_times = not (is_avi or is_irregular)
        # In AVI, images that do not build on others serve, if the index is right
        index = [(entry.timestamp, entry.pos + 8) for entry in self._stream.index_entries]
        is_seekable = self._decoder.codec.intra_only and places == index
        is_irregular |= is_avi and not is_seekable
        self._is_counted = self._is_raw or None in whole or is_irregular or order != sorted(order)
        self._keys = [] if self._is_counted else sorted(keys)
        return whole

    def _decode_rest(self) -> dict[int, int | None]:
        """Decode from here on, and return the time stamp of each frame by its tick.

        Without times of presentation, those of decoding come in the same steps. The last frames
        of a video with B-frames have none.
        """
        return {tick: frame.pts if self._has_times else frame.dts for tick, frame in self._decoded}

    def _times(self, stamps: list[int | None]) -> FloatArray | None:
        """Return the times [N] of stamps since the first, None if no camera takes them.

        Where they go back, another recording begins, after a pause that no clip holds.
        """
        unit_s = float(self._stream.time_base or 1)
        steps = np.diff(np.array(stamps, np.float64))  # NaN: without a stamp
        is_step = steps > 0
        usual = float(np.median(steps[is_step])) if is_step.any() else 0.0
        if len(steps) and usual * unit_s < MIN_STEP_S:
            return None
        pause = 2 / unit_s + 2 * usual
        steps = np.where(is_step, steps, np.where(steps < 0, pause, usual))
        times_s: FloatArray = np.cumsum([0.0, *steps]) * unit_s
        # Slow motion and time lapse state the rate of recording, other videos the nominal one
        with contextlib.suppress(ValueError):
            filmed_hz = float(self._container.metadata.get("com.android.capture.fps", "nan"))
            ratio = filmed_hz * usual * unit_s
            if not 0.7 < ratio < 1.5 and 1e-3 < ratio < 1e3:
                return times_s / ratio
        return times_s

    def _decode(self, index: int) -> ByteArray:
        """Return one frame; BadData if it is damaged."""
        tick = int(self._ticks[index])
        key = next((key for key in reversed(self._keys) if key <= tick), -math.inf)
        if not key <= self._last_tick < tick:
            self._seek(key)
        frame = self._advance(tick)
        if frame is None:  # the index of the container may have led to later frames
            self._restart()
            frame = self._advance(tick)
        image = None if frame is None else self._picture(frame)
        if image is None or image.shape[1::-1] != self.size_px:
            time = "" if self.times_s is None else f" ({self.times_s[index]:.2f} s)"
            raise BadData(
                f"{self.path}: frame {index} of {len(self)}{time} is damaged or has another size: "
                "choose frames before or after it, or repair the file"
            )
        return image

    def _seek(self, key: float) -> None:
        """Go to a key frame, or to the beginning."""
        with contextlib.suppress(av.FFmpegError):
            if self._keys:
                self._container.seek(int(max(key, self._keys[0])), stream=self._stream)
                self._decoder.flush_buffers()
                self._continue()
                return
        self._restart()

    def _advance(self, tick: int) -> Any:
        """Decode up to the frame of a tick and return it, None if it does not come."""
        for decoded_tick, frame in self._decoded:
            self._last_tick = decoded_tick
            if decoded_tick >= tick:
                return frame if decoded_tick == tick else None
        return None

    def _picture(self, frame: Any) -> ByteArray:
        """Return the RGB image [H, W, 3] of a frame."""
        image: Any = self._reformatter.reformat(frame, format="rgb24").to_ndarray()
        if frame.interlaced_frame:
            # the rows of the other field, which were recorded at another time, are interpolated
            image[1:-1:2] = cv2.addWeighted(image[:-2:2], 0.5, image[2::2], 0.5, 0)
        height_px, width_px = image.shape[:2]
        aspect = self._stream.sample_aspect_ratio or 1  # width of a pixel by its height
        if aspect != 1:
            wider_px = max(width_px, round(width_px * aspect))
            taller_px = max(height_px, round(height_px / aspect))
            image = cv2.resize(image, (wider_px, taller_px))
        # turned by about 90 degrees, mirrored or both
        (a, b), (c, d) = self._shown_from_stored
        is_transposed = abs(b) > abs(a)
        if is_transposed:
            a, d = c, b
        return oriented(
            image,
            is_transposed=is_transposed,
            has_rows_reversed=d < 0,
            has_columns_reversed=a < 0,
        )


def _packets(container: InputContainer, number: int) -> Iterator[Any]:
    """Yield the packets of a stream up to the end of the file, or to where it is damaged."""
    packets = container.demux(container.streams[number])
    while True:
        try:
            yield next(packets)
        except (StopIteration, av.FFmpegError):
            return


def is_video(path: Path) -> bool:
    """Return whether a file has the name of a visible video."""
    names = r"[^.].*\.(mp4|m4v|mov|mkv|webm|avi|m?2?ts|mpe?g|3gp|wmv|flv|h26[45]|hevc|mjpeg)"
    return bool(re.fullmatch(names, path.name, re.IGNORECASE)) and path.is_file()


def display_matrix(frame: Any) -> IntArray:
    """Return [[a, b], [c, d]], which maps stored (x, y) to (a x + c y, b x + d y) as it is shown.

    Side data are asked of one frame only, because they keep a frame in memory for long.
    """
    for item in frame.side_data:
        if item.type.name == "DISPLAYMATRIX":
            return np.frombuffer(bytes(item), np.int32).reshape(3, 3)[:2, :2]
    return np.eye(2, dtype=int)
