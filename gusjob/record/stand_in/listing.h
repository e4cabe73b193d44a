/*
 * The recorded listing: each call is a line that is in the file before the call returns.
 *
 *     [12.345] GT_LnXY(1,10000,0,50,2,0,0) = 0
 *     [53.25] AT_REST(1)
 *
 * Time in ms since the first call. AT_REST: the motion of a coordinate system has ended, before the call behind it.
 * Programs ask the same many times. Such calls (readings, and calls that are refused) that follow each other share one
 * line for each kind, which has the time of the first one, what the last one found, and how many there were. Only the
 * lines at the end of the file change, in place; so the file is whole whenever the process ends.
 */
#ifndef LISTING_H
#define LISTING_H

#include "calls.h"
#include "output.h"
#include "text.h"

#define KINDS 32 /* of readings that follow each other */
#define LONGEST_STRING 260 /* Windows takes no longer path. */
#define MOST_LISTINGS 100000

typedef struct {
    Text call, kind; /* with its answers; without those that change by themselves */
    double first_ms, last_ms;
    long long count;
} Reading;

typedef struct {
    Output output;
    int is_open, has_file, is_full;
    long long size;  /* bytes */
    long long start; /* of the readings at the end */
    int readings;
    Reading reading[KINDS];
} Listing;

static Listing listing[CARDS];
static double first_call_ms = -1; /* on the machine's clock */
static long own_process;
static double limit_bytes = 1e9;
static const char *time_name = "fast";

static int is_separator(PathChar c)
{
    return c == '/' || c == '\\';
}

/* calls.gts, calls.card1.gts for another card, calls.2.gts for a second process. */
static void name_listing(PathChar *name, size_t room, const PathChar *base, int number, int card)
{
    size_t end = path_length(base), i;
    PathChar number_part[24] = {0}, card_part[24] = {0};
    for (i = end; i > 1 && !is_separator(base[i - 1]) && !is_separator(base[i - 2]); i--)
        if (base[i - 1] == '.') {
            end = i - 1;
            break;
        }
    if (number > 1)
        path_print(number_part, 23, PATH_TEXT(".%d"), number);
    if (card > 0)
        path_print(card_part, 23, PATH_TEXT(".card%d"), card);
    path_print(name, room, PATH_STEM PATH_FORMAT PATH_FORMAT PATH_FORMAT, (int)end, base, number_part, card_part,
               base + end);
}

static void append(Listing *l, const char *text, size_t size)
{
    if (l->is_full)
        return;
    if (write_output(&l->output, text, size, l->size) != 0) {
        fprintf(stderr, "gusjob record: the listing can't be written: later calls are missing\n");
        cut_output(&l->output, l->size - 1); /* A listing that ends without a line's end is cut. */
        l->is_full = 1;
        return;
    }
    l->size += (long long)size;
}

static void append_text(Listing *l, const Text *t)
{
    append(l, t->text, t->size);
}

/* Opens the file of a card; existing files are kept. */
static void open_listing(int card)
{
    static const char *const ABI[] = {"gus", "gts", "gts-multi"};
    Listing *l = &listing[card];
    const PathChar *base = path_getenv(PATH_TEXT("GUSJOB_RECORD"));
    PathChar name[4096] = {0};
    const char *mark = getenv("GUSJOB_RECORD_OF");
    Text t = {.size = 0};
    int number = 0, exists = 0, failed;
    if (base == NULL || !*base)
        base = PATH_TEXT("calls.gts");
    *l = (Listing){.is_open = 1};
    do {
        name_listing(name, sizeof name / sizeof *name - 1, base, ++number, card);
        failed = create_output(&l->output, name, &exists);
    } while (exists && number < MOST_LISTINGS);
    if (failed) {
        fprintf(stderr, "gusjob record: " PATH_MESSAGE ": can't be written, no call is recorded\n", name);
        l->is_full = 1;
        return;
    }
    l->has_file = 1;
    print(&t, "// recorded by gusjob record, ABI %s", ABI[VC_ABI]);
    if (VC_ABI == 2)
        print(&t, ", card %d", card);
    print(&t, ", time %s", time_name);
    if (mark != NULL && (number > 1 || card > 0))
        print(&t, ", of %s", mark);
    print(&t, "\n");
    append_text(l, &t);
}

/* The listing of a card; a process that was forked has listings of its own. */
static Listing *listing_of(int card)
{
    int i;
    if (own_process != process_number()) {
        for (i = 0; i < CARDS; i++)
            if (listing[i].is_open) {
                if (listing[i].has_file)
                    forget_output(&listing[i].output);
                listing[i].is_open = 0;
            }
        own_process = process_number();
    }
    if (!listing[card].is_open)
        open_listing(card);
    return &listing[card];
}

/* ---- Lines --------------------------------------------------------------------------------------------------- */

/* ms, to 1 ns */
static void print_time(Text *t, double ms)
{
    char text[40];
    size_t end;
    snprintf(text, sizeof text, "%.6f", ms);
    set_point(text);
    end = strlen(text);
    while (text[end - 1] == '0')
        end--;
    if (text[end - 1] == '.')
        end--;
    print(t, "%.*s", (int)end, text);
}

/* A string of C; what is not printable ASCII is escaped. */
static void print_string(Text *t, const char *text)
{
    size_t i;
    if (text == NULL) {
        print(t, "NULL");
        return;
    }
    print(t, "\"");
    for (i = 0; text[i] && i < LONGEST_STRING; i++) {
        unsigned char c = (unsigned char)text[i];
        if (c == '"' || c == '\\')
            print(t, "\\%c", c);
        else if (c < 32 || c > 126)
            print(t, "\\%03o", c);
        else
            print(t, "%c", c);
    }
    print(t, text[i] ? "...\"" : "\"");
}

static void print_answers(Text *t, const double *out, int count, int in_braces)
{
    int i;
    if (in_braces)
        print(t, "{");
    for (i = 0; i < count; i++) {
        if (i > 0)
            print(t, ",");
        print_number(t, out[i]);
    }
    if (in_braces)
        print(t, "}");
}

/* A call; `changing`: with the answers that change by themselves. A refused call has no answers, only their names. */
static void print_call(Text *t, const Call *call, int code, const double *out, int changing)
{
    const double *a = call->given;
    const char *form;
    print(t, "%s(", call->name);
    for (form = call->form; *form; form++)
        if (*form == '#') {
            print_number(t, *a++);
        } else if (*form == '$') {
            print_string(t, call->text);
        } else if ((*form == '@' || *form == '~') && out != NULL && code == 0) {
            int volatile_answer = *form == '~', is_array = form[1] >= '0' && form[1] <= '9';
            int count = is_array ? form[1] - '0' : 1;
            if (changing || !volatile_answer)
                print_answers(t, out, count, is_array);
            out += count;
            while (form[1] && form[1] != ',' && form[1] != ')' && form[1] != '}')
                form++;
        } else if (*form == '@' || *form == '~') {
            form += form[1] >= '0' && form[1] <= '9';
        } else {
            print(t, "%c", *form);
        }
    print(t, ") = %d", code);
}

static void print_reading(Text *t, const Reading *r)
{
    print(t, "[");
    print_time(t, r->first_ms);
    print(t, "] %s", r->call.text);
    if (r->count > 1) {
        print(t, " // %lld times, the last at ", r->count);
        print_time(t, r->last_ms);
    }
}

/* Writes the readings at the end of the file anew. What becomes shorter is filled up with blanks. */
static void rewrite_readings(Listing *l)
{
    static char all[KINDS * sizeof(Text)];
    size_t size = 0, before = (size_t)(l->size - l->start);
    int i;
    if (l->is_full)
        return;
    for (i = 0; i < l->readings; i++) {
        Text t = {.size = 0};
        print_reading(&t, &l->reading[i]);
        memcpy(all + size, t.text, t.size);
        size += t.size;
        for (; i == l->readings - 1 && size + 1 < before; size++)
            all[size] = ' ';
        all[size++] = '\n';
    }
    l->size = l->start;
    append(l, all, size);
}

static void log_reading(Listing *l, double ms, const Call *call, int code, const double *out)
{
    Text kind = {.size = 0};
    Reading *r;
    int i;
    print_call(&kind, call, code, out, 0);
    for (i = 0; i < l->readings && strcmp(l->reading[i].kind.text, kind.text) != 0; i++)
        ;
    if (i == KINDS)
        l->readings = i = 0;
    if (l->readings == 0)
        l->start = l->size;
    r = &l->reading[i];
    if (i == l->readings) {
        l->readings++;
        r->kind = kind;
        r->first_ms = ms;
        r->count = 0;
    }
    r->call.size = 0;
    print_call(&r->call, call, code, out, 1);
    r->last_ms = ms;
    r->count++;
    rewrite_readings(l);
}

static int begins_with(const char *text, const char *begin)
{
    return strncmp(text, begin, strlen(begin)) == 0;
}

static int ends_with(const char *text, const char *end)
{
    size_t size = strlen(text), part = strlen(end);
    return size >= part && strcmp(text + size - part, end) == 0;
}

/* Whether a call only asks for something. */
static int is_reading(const char *name)
{
    if (begins_with(name, "GT_Get"))
        return 1;
    return !begins_with(name, "GT_Clear") && (ends_with(name, "Status") || ends_with(name, "Space"));
}

/* Ends the listing where it is too long. */
static void keep_limit(Listing *l)
{
    Text t = {.size = 0};
    if (l->is_full || (double)l->size < limit_bytes)
        return;
    print(&t, "// stopped: the listing has reached its limit of %.0f bytes, later calls are missing\n", limit_bytes);
    append_text(l, &t);
    l->is_full = 1;
}

static double since_first_ms(double clock)
{
    if (first_call_ms < 0)
        first_call_ms = clock;
    return clock - first_call_ms;
}

static void write_rest(int card, double clock, int crd)
{
    Listing *l = listing_of(card);
    Text t = {.size = 0};
    l->readings = 0;
    print(&t, "[");
    print_time(&t, since_first_ms(clock));
    print(&t, "] AT_REST(%d)\n", crd);
    append_text(l, &t);
}

/* The same motion as an abrupt stop of its coordinate system, which the listing's reader knows. */
static void write_stop(int card, double clock, int crd, const char *name)
{
    Listing *l = listing_of(card);
    Text t = {.size = 0};
    print(&t, "[");
    print_time(&t, since_first_ms(clock));
    print(&t, "] GT_Stop(%d,%d) = 0 // by %s\n", 0x80 << crd, 0x80 << crd, name);
    append_text(l, &t);
}

static void write_call(const Call *call, double clock, int code, const double *out)
{
    Listing *l = listing_of(call->card);
    double ms = since_first_ms(clock);
    if (code != 0 || is_reading(call->name)) {
        log_reading(l, ms, call, code, out);
    } else {
        Text t = {.size = 0};
        l->readings = 0;
        print(&t, "[");
        print_time(&t, ms);
        print(&t, "] ");
        print_call(&t, call, code, out, 1);
        print(&t, "\n");
        append_text(l, &t);
    }
    keep_limit(l);
}

#endif
