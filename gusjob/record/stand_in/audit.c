/*
 * For the loader of Linux (glibc, LD_AUDIT): a library that has a name of the stand-in is the stand-in, wherever the
 * program wants to load it from, in whatever case and version: libGTS.so.1. A program that names the vendor's library by
 * its path, or was linked with a path to it, must not drive the real controller.
 */
#define _GNU_SOURCE
#include <ctype.h>
#include <link.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

#define EXPORTED __attribute__((visibility("default")))

EXPORTED unsigned int la_version(unsigned int version)
{
    return version < LAV_CURRENT ? version : LAV_CURRENT;
}

/* In small letters, without what follows ".so". */
static void make_plain(char *name)
{
    char *end;
    size_t i;
    for (i = 0; name[i]; i++)
        name[i] = (char)tolower((unsigned char)name[i]);
    end = strstr(name, ".so.");
    if (end != NULL)
        end[3] = 0;
}

EXPORTED char *la_objsearch(const char *name, uintptr_t *cookie, unsigned int flag)
{
    const char *folder = getenv("GUSJOB_RECORD_FOLDER"), *slash = strrchr(name, '/');
    char path[4096];
    (void)cookie;
    (void)flag;
    if (folder == NULL || strlen(folder) + strlen(name) + 2 > sizeof path)
        return (char *)name;
    snprintf(path, sizeof path, "%s/%s", folder, slash ? slash + 1 : name);
    if (access(path, R_OK) != 0)
        make_plain(path + strlen(folder) + 1);
    return access(path, R_OK) == 0 ? strdup(path) : (char *)name;
}
