/*
 * The stand-in for the vendor's library (gusjob/record/stand_in) with controls for tests, to run programs against and
 * to see what comes out. The controls vc_* stand at the end.
 *
 * With VC_STATE=file the machine lives in that file and survives its process. A file lock keeps processes apart, and
 * goes with the process that holds it.
 */
#define ROWS 200000
#define EDGES 400000
#define LITS 200000
#define SHARED_STATE

#include "symbols.h"
#include "text.h"

#include <sys/mman.h>

/* ---- State in a file ----------------------------------------------------------------------------------------- */

static State unmapped;
static int state_file = -1;

static void lock_file(short type)
{
    struct flock lock = {.l_type = type, .l_whence = SEEK_SET};
    while (state_file >= 0 && fcntl(state_file, F_SETLKW, &lock) != 0 && errno == EINTR)
        ;
}

static void lock_shared_state(void)
{
    lock_file(F_WRLCK);
}

static void unlock_shared_state(void)
{
    lock_file(F_UNLCK);
}

static State *map_state(const char *path)
{
    void *mapped = MAP_FAILED;
    state_file = open(path, O_RDWR | O_CREAT | O_CLOEXEC, 0666);
    if (state_file >= 0 && ftruncate(state_file, sizeof(State)) == 0)
        mapped = mmap(NULL, sizeof(State), PROT_READ | PROT_WRITE, MAP_SHARED, state_file, 0);
    if (mapped == MAP_FAILED) {
        perror(path);
        abort();
    }
    return mapped;
}

__attribute__((constructor)) static void loaded(void)
{
    const char *path = getenv("VC_STATE");
    card_state[0] = state = path && *path ? map_state(path) : &unmapped;
    lock_state();
    if (atomic_load(&state->made) != sizeof *state)
        power_up();
    unlock_state();
}

/* VC_OPTIONS: name=value,name=value */
static void set_options(const char *text)
{
    char name[40];
    double value;
    int used;
    while (text && sscanf(text, " %39[^=,]=%lf%n", name, &value, &used) == 2) {
        if (set_option(name, value) != 0)
            fprintf(stderr, "VC_OPTIONS: no option %s\n", name);
        text += used;
        text += *text == ',';
    }
}

static void configure(void)
{
    set_options(getenv("VC_OPTIONS"));
}

static int works_closed(Effect *effect)
{
    return effect == open_card;
}

static int polls(const char *name)
{
    return strcmp(name, "GT_CrdStatus") == 0;
}

static double waited_ms(void)
{
    return 0;
}

static void log_rests(int card)
{
    (void)card;
}

/* ---- Call log ------------------------------------------------------------------------------------------------ */

static char **calls;
static long call_count, call_room;

/* "CODE NAME(arguments)", with the names of answers in place of their values. */
static void log_call(const Call *call, int code, const double *out)
{
    const double *a = call->given;
    const char *form = call->form;
    Text t = {.size = 0};
    (void)out;
    print(&t, "%d %s(", code, call->name);
    for (; *form; form++)
        if (*form == '#')
            print_number(&t, *a++);
        else if (*form == '$')
            print(&t, "%s", call->text ? call->text : "NULL");
        else if (*form != '@' && *form != '~')
            print(&t, "%c", *form);
        else if (form[1] >= '0' && form[1] <= '9')
            form++;
    print(&t, ")");
    if (call_count == call_room) {
        call_room = call_room ? 2 * call_room : 1024;
        calls = realloc(calls, (size_t)call_room * sizeof *calls);
    }
    calls[call_count++] = strdup(t.text);
}

/* ---- Test controls ------------------------------------------------------------------------------------------- */

/* As if switched off and on again, and newly loaded. */
void vc_reset(void)
{
    lock_state();
    power_up();
    while (call_count > 0)
        free(calls[--call_count]);
    unlock_state();
}

static struct {
    Core core;
    Slot slot[2][2][RING];
    Edge edge[2][LINES][PENDING];
} kept;

/* Keeps the machine as it is now, in this process. */
void vc_keep(void)
{
    enter(0);
    kept.core = *m;
    memcpy(kept.slot, state->slot, sizeof kept.slot);
    memcpy(kept.edge, state->edge, sizeof kept.edge);
    leave();
}

/* Makes the machine what it was at vc_keep. Its logs have only grown since: they end where they ended then. */
void vc_recall(void)
{
    enter(0);
    *m = kept.core;
    memcpy(state->slot, kept.slot, sizeof kept.slot);
    memcpy(state->edge, kept.edge, sizeof kept.edge);
    tie_clock();
    leave();
}

/* 0, or -1 for an unknown name. */
int vc_option(const char *name, double value)
{
    int found;
    enter(0);
    found = set_option(name, value);
    leave();
    return found;
}

/* From the nth call of that name on (1: the next; name "": any call), `count` times, or FOR_EVER or ALL_CALLS. */
void vc_fault(const char *name, long nth, long count, int what, double value)
{
    lock_state();
    plant_fault((Fault){.nth = nth, .count = count, .what = what, .value = value}, name);
    unlock_state();
}

/* Faults that were planted are gone; what hangs goes on hanging. */
void vc_clear_faults(void)
{
    lock_state();
    state->faults = 0;
    unlock_state();
}

/* Calls that hang go on, and later ones don't hang. */
void vc_release(void)
{
    atomic_store(&state->released, 1);
    atomic_fetch_add(&state->releases, 1);
}

/* Virtual time only: the wall clock goes by itself. */
void vc_advance(double ms)
{
    enter(0);
    spend(ms);
    leave();
}

long vc_calls(void)
{
    long count;
    lock_state();
    count = call_count;
    unlock_state();
    return count;
}

/* "CODE NAME(arguments)", valid until vc_reset. */
const char *vc_call(long i)
{
    const char *text;
    lock_state();
    text = i >= 0 && i < call_count ? calls[i] : NULL;
    unlock_state();
    return text;
}

static long row_count(void)
{
    return m->rows + (m->row_state == ENDED_ROW);
}

/* Pieces of timed calls that have ended. */
long vc_rows(void)
{
    long count;
    enter(0);
    count = row_count();
    leave();
    return count;
}

void vc_row(long i, double out[23])
{
    enter(0);
    if (i >= 0 && i < row_count())
        memcpy(out, i < m->rows ? state->row[i] : m->row, sizeof m->row);
    leave();
}

long vc_edges(void)
{
    long count;
    enter(0);
    count = m->edges;
    leave();
    return count;
}

void vc_edge(long i, double out[4])
{
    enter(0);
    if (i >= 0 && i < m->edges)
        memcpy(out, state->light[i], sizeof state->light[i]);
    leave();
}

static int is_lit(int channel)
{
    return m->lit_open[channel] && m->lit[channel][L_MS] > SLIVER;
}

/* Lit stretches, with those that are lit now, up to now. */
long vc_lits(void)
{
    long count;
    enter(0);
    count = m->lits + is_lit(0) + is_lit(1);
    leave();
    return count;
}

void vc_lit(long i, double out[20])
{
    enter(0);
    if (i >= 0 && i < m->lits)
        memcpy(out, state->lit[i], sizeof state->lit[i]);
    else if (i >= m->lits && i < m->lits + is_lit(0) + is_lit(1))
        lit_until(m->t, i == m->lits && is_lit(0) ? 0 : 1, out);
    leave();
}

void vc_state(double out[16])
{
    const Channel *c;
    enter(0);
    c = m->channel;
    out[0] = m->origin + m->t;
    out[1] = m->open;
    out[2] = m->moving;
    whereabouts(m->t, &out[10], &out[3], &out[4]);
    out[5] = c[0].line[LIGHT_LINE].on;
    out[6] = c[1].line[LIGHT_LINE].on;
    out[7] = c[0].command;
    out[8] = c[1].command;
    out[9] = (double)(used_slots(1, 0) + used_slots(1, 1) + used_slots(2, 0) + used_slots(2, 1));
    out[11] = m->axes;
    out[12] = c[0].total;
    out[13] = c[1].total;
    out[14] = running_ms();
    out[15] = (double)m->accepted;
    leave();
}
