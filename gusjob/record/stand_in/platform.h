/*
 * What differs between POSIX systems and Windows: exports, a lock, the clock, naps, files that are written in place.
 */
#ifndef PLATFORM_H
#define PLATFORM_H

#define _DEFAULT_SOURCE
#define _DARWIN_C_SOURCE
#define _FILE_OFFSET_BITS 64

#ifdef _WIN32
#define WIN32_LEAN_AND_MEAN
#include <windows.h>
#else
#include <errno.h>
#include <fcntl.h>
#include <pthread.h>
#include <sys/resource.h>
#include <sys/stat.h>
#include <unistd.h>
#endif

#include <math.h>
#include <signal.h>
#include <stdarg.h>
#include <stdatomic.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <time.h>

/* The head of each function of the ABI. The vendor's functions are __stdcall on Windows; a .def file exports them there,
   by their names alone. */
#ifdef _WIN32
#define KILL_SIGNAL 9
#define API short __stdcall
#else
#define KILL_SIGNAL SIGKILL
#define API __attribute__((visibility("default"))) short
#endif

#ifdef _WIN32

static SRWLOCK machine_lock = SRWLOCK_INIT;

static void take_lock(void)
{
    AcquireSRWLockExclusive(&machine_lock);
}

static void give_lock(void)
{
    ReleaseSRWLockExclusive(&machine_lock);
}

static double wall_ms(void)
{
    LARGE_INTEGER now, second;
    QueryPerformanceCounter(&now);
    QueryPerformanceFrequency(&second);
    return (double)now.QuadPart * 1e3 / (double)second.QuadPart;
}

static void nap_ms(double ms)
{
    Sleep((DWORD)ceil(ms));
}

static void signal_self(int number)
{
    if (number == SIGINT)
        raise(number);
    else
        TerminateProcess(GetCurrentProcess(), 128 + (UINT)number);
}

#else

static pthread_mutex_t machine_lock = PTHREAD_MUTEX_INITIALIZER;
static sigset_t before_lock; /* signals that the thread with the lock had blocked */

/* A handler of the program may make calls itself: it runs when the call that it would interrupt is over. */
static void take_lock(void)
{
    static const int OWN[] = {SIGSEGV, SIGBUS, SIGFPE, SIGILL, SIGABRT, SIGTRAP};
    sigset_t blocked, before;
    size_t i;
    sigfillset(&blocked);
    for (i = 0; i < sizeof OWN / sizeof *OWN; i++)
        sigdelset(&blocked, OWN[i]);
    pthread_sigmask(SIG_BLOCK, &blocked, &before);
    pthread_mutex_lock(&machine_lock);
    before_lock = before;
}

static void give_lock(void)
{
    sigset_t before = before_lock;
    pthread_mutex_unlock(&machine_lock);
    pthread_sigmask(SIG_SETMASK, &before, NULL);
}

static double wall_ms(void)
{
    struct timespec now;
    clock_gettime(CLOCK_MONOTONIC, &now);
    return (double)now.tv_sec * 1e3 + (double)now.tv_nsec / 1e6;
}

static void nap_ms(double ms)
{
    struct timespec nap = {.tv_sec = (time_t)(ms / 1000), .tv_nsec = (long)(fmod(ms, 1000) * 1e6)};
    while (nanosleep(&nap, &nap) != 0 && errno == EINTR)
        ;
}

static void signal_self(int number)
{
    kill(getpid(), number);
}

#endif
#endif
