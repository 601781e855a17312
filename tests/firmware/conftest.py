from collections.abc import Iterator

import pytest

from tests.firmware import devices
from tests.sim_hw.boards import Board
from tests.sim_hw.host import Host


@pytest.fixture(scope="module", params=devices.DEVICES)
def device(request: pytest.FixtureRequest) -> devices.Device:
    return devices.get(request.param)


@pytest.fixture(scope="module")
def board(device: devices.Device, tmp_path_factory: pytest.TempPathFactory) -> Iterator[Board]:
    """One board for all tests of a module that need no script and no log."""
    with device.running(tmp_path_factory.mktemp("board")) as board:
        yield board


@pytest.fixture
def host(board: Board) -> Iterator[Host]:
    host = Host(board.link)
    yield host
    host.close()
