/*
 * Text of calls.
 */
#ifndef TEXT_H
#define TEXT_H

#include "platform.h"

typedef struct {
    char text[1200];
    size_t size;
} Text;

__attribute__((format(printf, 2, 3))) static void print(Text *t, const char *format, ...)
{
    va_list args;
    int wrote;
    va_start(args, format);
    wrote = vsnprintf(t->text + t->size, sizeof t->text - t->size, format, args);
    va_end(args);
    t->size += (size_t)wrote;
    if (t->size >= sizeof t->text)
        t->size = sizeof t->text - 1;
}

/* Makes the decimal point of the program's locale a point. */
static void set_point(char *text)
{
    char *from = text + strspn(text, "+-0123456789");
    size_t point = strcspn(from, "+-0123456789abcdefghijklmnopqrstuvwxyz");
    if (point == 0)
        return;
    memmove(from + 1, from + point, strlen(from + point) + 1);
    *from = '.';
}

/* The shortest text that reads back to the same number. */
static void print_number(Text *t, double value)
{
    char text[40];
    int digits = 15;
    if (value == floor(value) && fabs(value) < 1e16) {
        print(t, "%.0f", value);
        return;
    }
    do
        snprintf(text, sizeof text, "%.*g", digits, value);
    while (strtod(text, NULL) != value && digits++ < 17);
    set_point(text);
    print(t, "%s", text);
}

#endif
