"""The control socket: who gets it, who is refused, and what is left behind."""

import fcntl
import grp
import os
import shutil
import socket as stdlib_socket
import stat
import subprocess
import sys
import threading
from pathlib import Path

import pytest

from hapticd.service.socket import MAX_PATH_BYTES, BoundSocket, SocketError, bind, claim, stop_path


@pytest.fixture(autouse=True)
def state_home(tmp_path_factory: pytest.TempPathFactory, monkeypatch: pytest.MonkeyPatch) -> Path:
    folder = tmp_path_factory.mktemp("state")
    monkeypatch.setenv("XDG_STATE_HOME", str(folder))
    monkeypatch.delenv("STATE_DIRECTORY", raising=False)
    return folder


@pytest.fixture
def path(tmp_path: Path) -> Path:
    return tmp_path / "h.sock"


def connects(path: Path) -> bool:
    with stdlib_socket.socket(stdlib_socket.AF_UNIX) as client:
        try:
            client.connect(str(path))
        except OSError:
            return False
    return True


def test_socket_answers_has_its_mode_and_goes_with_its_owner(path: Path) -> None:
    bound = bind(path, mode=0o620)
    assert connects(path)
    assert stat.S_IMODE(path.stat().st_mode) == 0o620
    bound.close()
    assert list(path.parent.iterdir()) == []


def test_group_by_name_and_number(path: Path) -> None:
    own = grp.getgrgid(os.getgid())
    for group in (own.gr_name, str(own.gr_gid)):
        bound = bind(path, group=group)
        assert path.stat().st_gid == own.gr_gid
        bound.close()


def test_umask_does_not_change_the_mode(path: Path) -> None:
    before = os.umask(0o077)
    try:
        bound = bind(path, mode=0o666)
    finally:
        os.umask(before)
    assert stat.S_IMODE(path.stat().st_mode) == 0o666
    bound.close()


def test_second_daemon_is_refused_and_does_no_harm(path: Path) -> None:
    first = bind(path)
    with pytest.raises(SocketError) as refusal:
        bind(path)
    assert str(refusal.value) == (
        f"another daemon (process {os.getpid()}) runs on {path}: stop it first, or choose another socket with --socket or "
        "api.socket"
    )
    assert connects(path)
    first.close()


def test_daemon_that_is_under_no_lock_is_found_because_it_answers(path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    first = bind(path)
    monkeypatch.setenv("XDG_STATE_HOME", str(path.parent / "another"))
    with pytest.raises(SocketError) as refusal:
        bind(path)
    assert str(refusal.value) == (
        f"another daemon answers on {path}: stop it first, or choose another socket with --socket or api.socket"
    )
    assert connects(path)
    first.close()


def test_daemon_with_a_full_queue_still_counts_as_alive(path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("hapticd.service.socket.PROBE_TIMEOUT_S", 0.05)
    with stdlib_socket.socket(stdlib_socket.AF_UNIX) as busy, stdlib_socket.socket(stdlib_socket.AF_UNIX) as guest:
        busy.bind(str(path))
        busy.listen(0)
        guest.connect(str(path))
        with pytest.raises(SocketError, match="another daemon answers"):
            bind(path)


def test_stale_socket_of_a_killed_daemon_is_replaced(path: Path) -> None:
    code = (
        "import os; from pathlib import Path; from hapticd.service.socket import bind; "
        f"bind(Path({str(path)!r})); os._exit(9)"
    )
    subprocess.run([sys.executable, "-c", code], check=False)
    assert path.is_socket()
    assert not connects(path)
    bound = bind(path)
    assert connects(path)
    bound.close()


@pytest.mark.parametrize("make", [Path.mkdir, lambda path: path.write_text("precious")])
def test_what_is_no_socket_is_left_alone(path: Path, make: object) -> None:
    assert callable(make)
    make(path)
    with pytest.raises(SocketError) as refusal:
        bind(path)
    assert str(refusal.value) == (
        f"{path} exists and is not a socket: remove it, or choose another with --socket or api.socket"
    )
    assert path.exists()


def test_symbolic_link_is_not_followed(path: Path, tmp_path: Path) -> None:
    path.symlink_to(tmp_path / "elsewhere")
    with pytest.raises(SocketError, match="is not a socket"):
        bind(path)
    assert not (tmp_path / "elsewhere").exists()


def test_path_too_long_says_how_long(tmp_path: Path) -> None:
    path = tmp_path / ("x" * MAX_PATH_BYTES)
    with pytest.raises(SocketError) as refusal:
        bind(path)
    assert str(refusal.value) == (
        f"socket path {path} is {len(str(path))} bytes long; a Unix socket's path is at most 107 bytes: "
        "choose a shorter one with --socket or api.socket"
    )


def test_longest_path_is_accepted(tmp_path: Path) -> None:
    path = tmp_path / ("x" * (MAX_PATH_BYTES - len(str(tmp_path)) - 1))
    bound = bind(path)
    assert connects(path)
    bound.close()


def test_missing_directory_is_made(tmp_path: Path) -> None:
    path = tmp_path / "run" / "h.sock"
    bound = bind(path)
    assert stat.S_IMODE(path.parent.stat().st_mode) == 0o755
    bound.close()


def test_directory_that_cannot_be_made_is_an_error(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("")
    path = tmp_path / "file" / "h.sock"
    with pytest.raises(SocketError) as refusal:
        bind(path)
    assert str(refusal.value) == f"cannot create the control socket {path}: {path.parent} is not a directory"


def test_unknown_group_leaves_nothing_behind(path: Path) -> None:
    with pytest.raises(SocketError) as refusal:
        bind(path, group="no-such-group")
    assert str(refusal.value) == "api.group = 'no-such-group': no such group on this machine"
    assert list(path.parent.iterdir()) == []


def test_failure_after_the_bind_leaves_nothing_behind(path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def refuse(*_: object) -> None:
        raise PermissionError(1, "Operation not permitted")

    monkeypatch.setattr(os, "chown", refuse)
    with pytest.raises(SocketError) as refusal:
        bind(path, group="0")
    assert str(refusal.value) == f"cannot create the control socket {path}: Operation not permitted"
    assert list(path.parent.iterdir()) == []


def test_close_leaves_the_socket_of_another_daemon(path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    first = bind(path)
    path.unlink()
    monkeypatch.setenv("XDG_STATE_HOME", str(path.parent / "another"))
    second = bind(path)
    first.close()
    assert connects(path)
    second.close()


def test_close_when_the_directory_is_gone(tmp_path: Path) -> None:
    bound = bind(tmp_path / "run" / "h.sock")
    bound.path.unlink()
    bound.path.parent.rmdir()
    bound.close()
    assert bound.socket.fileno() == -1


def test_of_many_that_start_at_once_exactly_one_wins(path: Path) -> None:
    barrier = threading.Barrier(8)
    won: list[BoundSocket] = []
    refused: list[SocketError] = []

    def contend() -> None:
        barrier.wait()
        try:
            won.append(bind(path))
        except SocketError as error:
            refused.append(error)

    threads = [threading.Thread(target=contend) for _ in range(8)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert (len(won), len(refused)) == (1, 7)
    assert connects(path)
    won[0].close()
    assert list(path.parent.iterdir()) == []


def test_a_lock_on_the_socket_s_folder_is_nobody_s_business(path: Path) -> None:
    """Who may read a folder may lock it: another user kept a daemon from starting, and from ending."""
    holder = os.open(path.parent, os.O_RDONLY)
    fcntl.flock(holder, fcntl.LOCK_EX)
    bound = bind(path)
    assert connects(path)
    bound.close()
    os.close(holder)
    assert not path.exists()


def test_the_second_is_refused_though_socket_and_folder_are_gone(tmp_path: Path) -> None:
    first = bind(tmp_path / "run" / "h.sock")
    shutil.rmtree(tmp_path / "run")
    with pytest.raises(SocketError, match=rf"another daemon \(process {os.getpid()}\) runs on"):
        bind(first.path)
    assert not first.path.exists()
    first.close()
    bind(first.path).close()


def test_lock_is_one_s_own_and_leaves_nothing_behind(path: Path, state_home: Path) -> None:
    bound = bind(path)
    (lock,) = (state_home / "hapticd").iterdir()
    assert stat.S_IMODE(lock.stat().st_mode) == 0o600
    assert lock.read_text() == f"{os.getpid()}\n"
    bound.close()
    assert list(state_home.iterdir()) == []


def test_lock_of_a_killed_daemon_is_none(path: Path, state_home: Path) -> None:
    code = (
        "import os; from pathlib import Path; from hapticd.service.socket import bind; "
        f"bind(Path({str(path)!r})); os._exit(9)"
    )
    subprocess.run([sys.executable, "-c", code], check=False)
    assert len(list((state_home / "hapticd").iterdir())) == 1
    bind(path).close()


def test_without_a_state_folder_there_is_a_word_and_no_lock(
    path: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    (tmp_path / "file").write_text("")
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path / "file"))
    bound = bind(path)
    assert bound.lock is None
    assert f"no lock against a second daemon on {path}" in caplog.text
    with pytest.raises(SocketError, match="another daemon answers"):
        bind(path)
    bound.close()


def test_that_there_is_no_lock_is_said_once(
    path: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    (tmp_path / "file").write_text("")
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path / "file"))
    bind(path, claimed=claim(path)).close()
    assert caplog.text.count("no lock against a second daemon") == 1


def test_who_still_has_the_stop_channel_is_found_though_the_control_socket_is_gone(
    path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    first = bind(stop_path(path), kind=stdlib_socket.SOCK_DGRAM)
    for _ in range(2):
        with pytest.raises(SocketError, match=rf"another daemon answers on {path}\.stop"):
            claim(path)
        monkeypatch.setenv("XDG_STATE_HOME", str(path.parent / "another"))
    with pytest.raises(SocketError, match="another daemon answers"):
        bind(first.path, kind=stdlib_socket.SOCK_DGRAM)
    assert first.intact()
    first.close()
    with stdlib_socket.socket(stdlib_socket.AF_UNIX, stdlib_socket.SOCK_DGRAM) as left_by_a_kill:
        left_by_a_kill.bind(str(first.path))
    claim(path).release()
    assert not first.path.exists()


def test_a_removed_lock_is_taken_anew(path: Path, state_home: Path) -> None:
    bound = bind(path)
    assert bound.lock is not None
    assert not bound.lock.mend()
    shutil.rmtree(state_home)
    assert bound.lock.mend()
    with pytest.raises(SocketError, match="another daemon"):
        bind(path)
    bound.close()
    assert not bound.lock.path.exists()


def test_a_removed_socket_is_bound_anew_with_its_mode(tmp_path: Path) -> None:
    bound = bind(tmp_path / "run" / "h.sock", mode=0o620)
    assert bound.intact()
    shutil.rmtree(tmp_path / "run")
    assert not bound.intact()
    with bound.socket:
        bound.rebind()
    assert bound.intact()
    assert connects(bound.path)
    assert stat.S_IMODE(bound.path.stat().st_mode) == 0o620
    bound.close()
    assert list((tmp_path / "run").iterdir()) == []


def test_a_replaced_socket_is_not_ours_and_one_that_answers_is_left(path: Path) -> None:
    bound = bind(path)
    path.unlink()
    with stdlib_socket.socket(stdlib_socket.AF_UNIX) as other:
        other.bind(str(path))
        assert not bound.intact()
        other.listen()
        with pytest.raises(SocketError, match="another daemon answers"):
            bound.rebind()
    bound.close()
    assert path.exists()


def test_who_waits_on_the_number_of_a_datagram_socket_hears_what_comes_to_the_new_one(tmp_path: Path) -> None:
    bound = bind(tmp_path / "run" / "h.sock.stop", kind=stdlib_socket.SOCK_DGRAM)
    number = bound.socket.fileno()
    shutil.rmtree(tmp_path / "run")
    assert bound.rebind().fileno() == number
    with stdlib_socket.socket(stdlib_socket.AF_UNIX, stdlib_socket.SOCK_DGRAM) as client:
        client.sendto(b"stop", str(bound.path))
    assert os.read(number, 8) == b"stop"
    assert not os.get_inheritable(number)
    bound.close()
    assert list((tmp_path / "run").iterdir()) == []


def test_a_socket_that_is_closed_is_not_bound_anew(path: Path) -> None:
    """The daemon may look at itself while it ends."""
    bound = bind(path)
    bound.close()
    with pytest.raises(SocketError, match="is closed"):
        bound.rebind()
    assert not path.exists()
