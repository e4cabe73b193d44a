/*
 * A new file that is written in place, each piece at once: what is written stays if the process is killed.
 */
#ifndef OUTPUT_H
#define OUTPUT_H

#include "platform.h"

#ifdef _WIN32

typedef HANDLE Output;
typedef wchar_t PathChar;
#define NO_OUTPUT INVALID_HANDLE_VALUE
#define PATH_TEXT(text) L##text
#define PATH_FORMAT L"%ls"
#define PATH_STEM L"%.*ls"
#define PATH_MESSAGE "%ls"
#define path_print _snwprintf
#define path_length wcslen
#define path_getenv _wgetenv

static long process_number(void)
{
    return (long)GetCurrentProcessId();
}

/* Creates a file, never an existing one; NO_OUTPUT if that fails. It is locked as long as this process lives. */
static Output create_output(const PathChar *path, int *exists)
{
    Output made = CreateFileW(path, GENERIC_WRITE, FILE_SHARE_READ, NULL, CREATE_NEW, FILE_ATTRIBUTE_NORMAL, NULL);
    *exists = made == NO_OUTPUT && GetLastError() == ERROR_FILE_EXISTS;
    return made;
}

/* 0, or -1 if not all of it was written. */
static int write_output(Output output, const char *text, size_t size, long long at)
{
    OVERLAPPED where = {.Offset = (DWORD)at, .OffsetHigh = (DWORD)(at >> 32)};
    DWORD wrote = 0;
    return WriteFile(output, text, (DWORD)size, &wrote, &where) && wrote == size ? 0 : -1;
}

static void close_output(Output output)
{
    CloseHandle(output);
}

#else

typedef int Output;
typedef char PathChar;
#define NO_OUTPUT (-1)
#define PATH_TEXT(text) text
#define PATH_FORMAT "%s"
#define PATH_STEM "%.*s"
#define PATH_MESSAGE "%s"
#define path_print snprintf
#define path_length strlen
#define path_getenv getenv

static long process_number(void)
{
    return (long)getpid();
}

static Output create_output(const PathChar *path, int *exists)
{
    struct flock lock = {.l_type = F_WRLCK, .l_whence = SEEK_SET};
    Output made = open(path, O_WRONLY | O_CREAT | O_EXCL | O_CLOEXEC, 0666);
    *exists = made == NO_OUTPUT && errno == EEXIST;
    if (made != NO_OUTPUT)
        (void)fcntl(made, F_SETLK, &lock);
    return made;
}

static int write_output(Output output, const char *text, size_t size, long long at)
{
    while (size > 0) {
        ssize_t wrote = pwrite(output, text, size, (off_t)at);
        if (wrote < 0 && errno == EINTR)
            continue;
        if (wrote <= 0)
            return -1;
        text += wrote;
        at += wrote;
        size -= (size_t)wrote;
    }
    return 0;
}

static void close_output(Output output)
{
    close(output);
}

#endif
#endif
