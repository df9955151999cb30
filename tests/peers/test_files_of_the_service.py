"""Ground stations' own clients read the component's files from the service, by sockets.

MAVSDK and pymavlink stand beside the fake PX4, which routes between them and the service.
"""

from __future__ import annotations

import asyncio
import contextlib
import hashlib
import lzma

import pytest
from mavsdk.asyncio.plugins.component_metadata import ComponentMetadataAsync
from mavsdk.asyncio.plugins.ftp import FtpAsync
from mavsdk.plugins.component_metadata import MetadataType
from mavsdk.plugins.ftp import FtpError, FtpResult
from pymavlink import mavftp, mavutil

from moar_companion.mavlink.component.component_metadata import metadata_files

from .pilot import FOUND_WITHIN_S, vehicle
from .processes import companion_beside_autopilot

COMPONENT = 195
FILES = metadata_files(COMPONENT)


def digests(files):
    return {name: hashlib.sha256(data).hexdigest() for name, data in files.items()}


@pytest.mark.slow
def test_mavsdk_and_pymavlink_download_the_files_of_the_service(tmp_path, monkeypatch):
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))  # MAVSDK keeps what it has downloaded
    with companion_beside_autopilot(tmp_path) as (mavsdk_port, pymavlink_port):
        assert digests(asyncio.run(downloaded_by_mavsdk(mavsdk_port, tmp_path))) == digests(FILES)
        monkeypatch.chdir(tmp_path)
        assert digests(downloaded_by_pymavlink(pymavlink_port)) == digests(FILES)


async def downloaded_by_mavsdk(port, folder):
    async with vehicle(port) as system:
        ftp = FtpAsync(system)
        await ftp.set_target_compid(COMPONENT)
        listed = await ftp.list_directory("/")
        assert {entry.name for entry in listed.entries} == set(FILES)
        files = {}
        for name, burst in zip(FILES, (False, True, True), strict=True):
            async for _ in ftp.download(f"/{name}", str(folder), burst):
                pass
            files[name] = (folder / name).read_bytes()
            assert await ftp.are_files_identical(str(folder / name), f"/{name}")
        with pytest.raises(FtpError) as refused:
            await ftp.remove_file("/general.json.xz")
        assert refused.value.args[0] == FtpResult.FILE_PROTECTED
        assert await metadata(system) == lzma.decompress(FILES["parameter.json.xz"]).decode()
        return files


async def metadata(system):
    """The description of the parameters, as MAVSDK finds it by COMPONENT_METADATA."""
    plugin = ComponentMetadataAsync(system)

    async def available():
        async with contextlib.aclosing(plugin.subscribe_metadata_available()) as updates:
            async for update in updates:
                if (update.compid, update.type) == (COMPONENT, MetadataType.PARAMETER):
                    return update.json_metadata
        raise AssertionError("the stream has ended")

    waiting = asyncio.create_task(available())
    await plugin.request_component(COMPONENT)
    return await asyncio.wait_for(waiting, FOUND_WITHIN_S)


def downloaded_by_pymavlink(port):
    with contextlib.closing(
        mavutil.mavlink_connection(f"udpin:127.0.0.1:{port}", source_system=254)
    ) as link:
        assert link.wait_heartbeat(timeout=FOUND_WITHIN_S) is not None
        client = mavftp.MAVFTP(link, target_system=1, target_component=COMPONENT)
        files = {}
        for name in FILES:
            client.cmd_get(
                [f"/{name}"], callback=lambda file, name=name: files.update({name: file.read()})
            )
            client.process_ftp_reply("OpenFileRO", timeout=20)
        return files
