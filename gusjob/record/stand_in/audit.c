/*
 * For the loader of Linux (glibc, LD_AUDIT): a library that has a name of the stand-in is the stand-in, wherever the
 * program wants to load it from. A program that names the vendor's library by its path, or was linked with a path to
 * it, must not drive the real controller.
 */
#define _GNU_SOURCE
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

EXPORTED char *la_objsearch(const char *name, uintptr_t *cookie, unsigned int flag)
{
    const char *folder = getenv("GUSJOB_RECORD_FOLDER"), *slash = strrchr(name, '/');
    char path[4096];
    (void)cookie;
    (void)flag;
    if (folder == NULL || strlen(folder) + strlen(name) + 2 > sizeof path)
        return (char *)name;
    snprintf(path, sizeof path, "%s/%s", folder, slash ? slash + 1 : name);
    return access(path, R_OK) == 0 ? strdup(path) : (char *)name;
}
