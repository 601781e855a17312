"""The drive seen by other people's software: the canopen package over python-can's udp_multicast."""

import contextlib
import queue
import struct

import can
import canopen
import pytest
from canopen.profiles.p402 import BaseNode402

from sim_hw import log
from sim_hw.canopen.dictionary import EDS
from tests.polling import PATIENCE_S, multicast_group


@pytest.fixture
def channel():
    return multicast_group()


def test_canopen_package_drives_it_over_udp_multicast(start_drive, channel):
    drive, _ = start_drive(bus=["--interface", "udp_multicast", "--channel", channel])
    assert drive.ready["interface"] == "udp_multicast"
    network = canopen.Network()
    network.connect(interface="udp_multicast", channel=channel)
    with contextlib.ExitStack() as stack:
        stack.callback(network.disconnect)
        node = BaseNode402(1, str(EDS))
        network.add_node(node)
        node.sdo.RESPONSE_TIMEOUT = PATIENCE_S
        assert node.sdo[0x1000].raw == 0x00020192
        assert node.sdo[0x1008].raw == "hapticd simulated servo drive"
        with pytest.raises(canopen.SdoAbortedError) as refusal:
            node.sdo[0x6060].raw = 8
        assert refusal.value.code == 0x06090030
        node.nmt.send_command(128)
        node.sdo[0x6087].raw = 0
        node.sdo[0x6060].raw = 10
        node.tpdo.read()
        node.rpdo.read()
        for pdo, kind, names in (
            (node.tpdo[1], 1, (0x6041, 0x6064, 0x6077)),
            (node.rpdo[1], 255, (0x6040, 0x6071)),
        ):
            pdo.clear()
            for index in names:
                pdo.add_variable(index)
            pdo.trans_type = kind
            pdo.enabled = True
            pdo.save()
        node.nmt.state = "OPERATIONAL"
        for word in (0x06, 0x07, 0x0F):
            node.rpdo[1][0x6040].raw = word
            node.rpdo[1][0x6071].raw = 0
            node.rpdo[1].transmit()
        arrived = queue.Queue()
        node.tpdo[1].add_callback(arrived.put)
        for _ in range(20):
            network.sync.transmit()
            arrived.get(timeout=PATIENCE_S)
            node.rpdo[1][0x6071].raw = 150
            node.rpdo[1].transmit()
        network.sync.transmit()
        arrived.get(timeout=PATIENCE_S)
        assert node.tpdo[1][0x6041].raw & 0x6F == 0x27
        assert node.tpdo[1][0x6077].raw == 150
        assert node.tpdo[1][0x6064].raw > 0
    rows = drive.stop()
    assert drive.returncode == 0
    assert (rows["event"] == log.SAMPLE).sum() == 21


def test_guarding_over_python_can(start_drive, channel):
    start_drive(bus=["--interface", "udp_multicast", "--channel", channel])
    with can.Bus(interface="udp_multicast", channel=channel) as bus:
        states = []
        for _ in range(2):
            bus.send(can.Message(arbitration_id=0x701, is_remote_frame=True, is_extended_id=False))
            while (reply := bus.recv(PATIENCE_S)).is_remote_frame:  # udp_multicast may show us our own
                pass
            assert reply.arbitration_id == 0x701
            states.append(struct.unpack("<B", reply.data)[0])
    assert states == [127, 255]
