"""The listing's file, whatever the program does with its own files, signals, processes and locale."""

from __future__ import annotations

import shutil
import subprocess
import sys
from pathlib import Path

import pytest
from support.recorded import calls, compiled, lines, needs_compiler

from gusjob.record.recording import Recording, RecordOptions, record

pytestmark = needs_compiler

BEGIN = """
#define _GNU_SOURCE
#include <fcntl.h>
#include <locale.h>
#include <pthread.h>
#include <signal.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/resource.h>
#include <sys/wait.h>
#include <unistd.h>
#include "gts.h"
static TCrdPrm prm = {2, {1, 2}, 500, 20, 0, 1, {0}};
static void begin(void) { GT_Open(0, 1); GT_SetCrdPrm(1, &prm); GT_CrdClear(1, 0); }
"""


def recorded(folder: Path, source: str, *args: object) -> Recording:
    """Record a C program into calls.gts."""
    program = compiled(folder, BEGIN + source)
    made = record(RecordOptions(command=(str(program), *map(str, args)), output=folder / "calls.gts"))
    assert isinstance(made, Recording), made
    return made


def test_files_of_a_program_that_closes_all_it_does_not_know(tmp_path: Path) -> None:
    """It gets the numbers for files of its own, and a child of it does, too: nothing of the listing gets into them."""
    source = """
static int own(const char *path)
{
    int last = 0, file = open(path, O_WRONLY | O_CREAT | O_TRUNC, 0666);
    while (last < 900)
        last = dup(file);
    return file;
}
int main(int n, char **args)
{
    int i, file;
    begin();
    if (n > 1 && chdir("/") != 0)
        return 2;
    for (i = 3; i < 1000; i++)
        close(i);
    file = own(args[1]);
    GT_LaserPrfCmd(1, 0);
    if (fork() == 0) {
        GT_LaserPrfCmd(2, 0);
        _exit(write(file, "child\\n", 6) != 6);
    }
    wait(0);
    GT_LaserPrfCmd(3, 0);
    return write(file, "END\\n", 4) != 4;
}
"""
    assert recorded(tmp_path, source, tmp_path / "own.txt").exit_code == 0
    assert (tmp_path / "own.txt").read_text() == "child\nEND\n"
    assert [c for c in calls(tmp_path / "calls.gts") if "Prf" in c] == [f"GT_LaserPrfCmd({i},0) = 0" for i in (1, 3)]
    assert calls(tmp_path / "calls.2.gts") == ["GT_LaserPrfCmd(2,0) = 0"]


def test_a_program_without_output(tmp_path: Path) -> None:
    """It has closed its standard files: the listing must not get their numbers, to which it writes all the same."""
    source = """
int main(void)
{
    close(0); close(1); close(2);
    begin();
    for (int i = 0; i < 3; i++)
        if (write(i, "lost\\n", 5) >= 0)
            return 1;
    GT_Close();
    return 0;
}
"""
    assert recorded(tmp_path, source).exit_code == 0
    assert calls(tmp_path / "calls.gts")[-1] == "GT_Close() = 0"
    assert "lost" not in (tmp_path / "calls.gts").read_text()


@pytest.mark.skipif(sys.platform != "linux" or not shutil.which("localedef"), reason="makes a locale as on Linux")
def test_a_decimal_comma(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]) -> None:
    made = subprocess.run(
        ["localedef", "-i", "de_DE", "-f", "UTF-8", tmp_path / "de_DE.UTF-8"], check=False, capture_output=True
    )
    if made.returncode not in (0, 1) or not (tmp_path / "de_DE.UTF-8").exists():
        pytest.skip("no source of the locale")
    monkeypatch.setenv("LOCPATH", str(tmp_path))
    monkeypatch.setenv("LC_ALL", "de_DE.UTF-8")
    recorded(
        tmp_path, 'int main(void) { setlocale(LC_ALL, ""); begin(); GT_LaserPrfCmd(1 / 3., 0); printf("%g", 0.5); }'
    )
    assert capfd.readouterr().out == "0,5"
    assert lines(tmp_path / "calls.gts")[-1] == "[0.06] GT_LaserPrfCmd(0.3333333333333333,0) = 0"


def test_calls_of_a_signal_handler(tmp_path: Path) -> None:
    """It comes in the middle of a call, many times."""
    source = """
static volatile int count;
static void handle(int number) { (void)number; GT_SetHSIOOpt(count++ % 2, 0); }
int main(void)
{
    alarm(20);
    signal(SIGUSR1, handle);
    begin();
    if (fork() == 0) {
        for (int i = 0; i < 500; i++) {
            usleep(100);
            kill(getppid(), SIGUSR1);
        }
        _exit(0);
    }
    while (waitpid(-1, 0, WNOHANG) == 0)
        for (int i = 0; i < 100; i++)
            GT_LaserPrfCmd(i, 0);
    printf("%d\\n", count);
    return count > 20 ? 0 : 1;
}
"""
    assert recorded(tmp_path, source).exit_code == 0
    found = [c for c in calls(tmp_path / "calls.gts") if "HSIO" in c]
    assert found == [f"GT_SetHSIOOpt({i % 2},0) = 0" for i in range(len(found))]


def test_a_process_is_forked_while_a_thread_makes_calls(tmp_path: Path) -> None:
    source = """
static void *poll(void *none) { short run; long segment; for (;;) GT_CrdStatus(1, &run, &segment, 0); return none; }
int main(void)
{
    pthread_t thread;
    begin();
    pthread_create(&thread, 0, poll, 0);
    for (int i = 0; i < 60; i++) {
        int status;
        pid_t child = fork();
        if (child == 0) {
            alarm(3);
            GT_SetHSIOOpt(0, 0);
            _exit(0);
        }
        waitpid(child, &status, 0);
        if (status != 0)
            return 1;
    }
    return 0;
}
"""
    assert recorded(tmp_path, source).exit_code == 0


def test_a_full_disk(tmp_path: Path) -> None:
    """As far as it was written it is there, and it says that it is cut."""
    source = """
int main(void)
{
    struct rlimit most = {3000, 3000};
    signal(SIGXFSZ, SIG_IGN);
    setrlimit(RLIMIT_FSIZE, &most);
    begin();
    for (int i = 0; i < 1000; i++)
        GT_LaserPrfCmd(i % 100, 0);
    return 0;
}
"""
    made = recorded(tmp_path, source)
    assert made.is_cut
    text = (tmp_path / "calls.gts").read_text()
    assert text.splitlines()[-2:] == [
        "// stopped: the listing could not be written, later calls are missing",
        "// ended with exit code 0",
    ]
    assert len(calls(tmp_path / "calls.gts")) == len(lines(tmp_path / "calls.gts")) > 50
