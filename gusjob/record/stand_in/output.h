/*
 * A new file that is written in place, each piece at once: what is written stays if the process is killed.
 */
#ifndef OUTPUT_H
#define OUTPUT_H

#include "platform.h"

#ifdef _WIN32

typedef struct {
    HANDLE file;
} Output;
typedef wchar_t PathChar;
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

/* Creates a file, never an existing one; -1 if that fails. It is locked as long as this process lives. */
static int create_output(Output *made, const PathChar *path, int *exists)
{
    made->file = CreateFileW(path, GENERIC_WRITE, FILE_SHARE_READ, NULL, CREATE_NEW, FILE_ATTRIBUTE_NORMAL, NULL);
    *exists = made->file == INVALID_HANDLE_VALUE && GetLastError() == ERROR_FILE_EXISTS;
    return made->file == INVALID_HANDLE_VALUE ? -1 : 0;
}

/* 0, or -1 if not all of it was written. */
static int write_output(Output *output, const char *text, size_t size, long long at)
{
    OVERLAPPED where = {.Offset = (DWORD)at, .OffsetHigh = (DWORD)(at >> 32)};
    DWORD wrote = 0;
    return WriteFile(output->file, text, (DWORD)size, &wrote, &where) && wrote == size ? 0 : -1;
}

/* Ends the file at a size. */
static void cut_output(Output *output, long long size)
{
    LARGE_INTEGER at = {.QuadPart = size};
    if (SetFilePointerEx(output->file, at, NULL, FILE_BEGIN))
        SetEndOfFile(output->file);
}

/* Forgets the file of the process that this one was forked from; there is none. */
static void forget_output(Output *output)
{
    (void)output;
}

#else

/* The program may close this file, as those do that close all that they have not opened, and may get its number for a
   file of its own. So it has a high number, and is known by its device and node. */
typedef struct {
    int file;
    dev_t device;
    ino_t node;
    char *path;
} Output;
typedef char PathChar;
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

static int is_own_file(const Output *output)
{
    struct stat about;
    return fstat(output->file, &about) == 0 && about.st_dev == output->device && about.st_ino == output->node;
}

/* Gives an open file a high number, and locks it, as long as this process lives. */
static int adopt_file(Output *output, int file)
{
    static const int NUMBERS[] = {700, 200, 50, 3};
    struct flock lock = {.l_type = F_WRLCK, .l_whence = SEEK_SET};
    size_t i;
    output->file = -1;
    for (i = 0; i < sizeof NUMBERS / sizeof *NUMBERS && output->file < 0; i++)
        output->file = fcntl(file, F_DUPFD_CLOEXEC, NUMBERS[i]);
    close(file);
    if (output->file < 0)
        return -1;
    (void)fcntl(output->file, F_SETLK, &lock);
    return 0;
}

static int create_output(Output *made, const PathChar *path, int *exists)
{
    struct stat about;
    int file = open(path, O_WRONLY | O_CREAT | O_EXCL | O_CLOEXEC, 0666);
    *exists = file < 0 && errno == EEXIST;
    if (file < 0 || adopt_file(made, file) != 0 || fstat(made->file, &about) != 0)
        return -1;
    made->device = about.st_dev;
    made->node = about.st_ino;
    made->path = realpath(path, NULL); /* The program may go to another folder. */
    return 0;
}

/* Opens the file again if it was closed. */
static int hold_output(Output *output)
{
    int file;
    if (is_own_file(output))
        return 0;
    file = output->path ? open(output->path, O_WRONLY | O_CLOEXEC) : -1;
    return file >= 0 && adopt_file(output, file) == 0 && is_own_file(output) ? 0 : -1;
}

static int write_output(Output *output, const char *text, size_t size, long long at)
{
    if (hold_output(output) != 0)
        return -1;
    while (size > 0) {
        ssize_t wrote = pwrite(output->file, text, size, (off_t)at);
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

static void cut_output(Output *output, long long size)
{
    if (hold_output(output) == 0 && ftruncate(output->file, (off_t)size) != 0)
        return;
}

static void forget_output(Output *output)
{
    if (is_own_file(output))
        close(output->file);
    free(output->path);
}

#endif
#endif
