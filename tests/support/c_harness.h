/* What the texts of c_programs.py find around them. The prototypes of the GT_ calls stand before it. */
#define _DEFAULT_SOURCE
#include <setjmp.h>
#include <signal.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/time.h>

short rtn, run;
long segment, space;
int i, j, k, n, fast, more, thin;
short stale;
long g_power, g_pos[4], *g_alias = g_pos;
unsigned g_unsigned;
_Bool g_flag;
struct { long len, wid; short s; } g_pt;
unsigned char g_small;
float g_float;
TCrdPrm g_prm;

static long *kept;
static int readiness;
static sigjmp_buf out_of_text;
enum { RAN, UNDEFINED, ENDLESS };

static void set_globals(void)
{
    rtn = run = 0;
    segment = space = 0;
    i = j = k = n = more = thin = readiness = 0;
    fast = 1;
    g_power = 30;
    g_small = 3;
    g_float = 3;
    stale = 3;
    g_unsigned = 0;
    g_flag = 0;
    memset(&g_pt, 0, sizeof g_pt);
    for (int at = 0; at < 4; at++)
        g_pos[at] = 100 + at;
    memset(&g_prm, 0, sizeof g_prm);
    g_prm.evenTime = 7;
    g_prm.profile[3] = 4;
    g_prm.originPos[2] = 99;
    kept = NULL;
}

static long ReadPower(void) { return 42; }
static void ReadTarget(long *target) { *target = 777; }
static void Fill(long *to, int count) { while (count--) to[count] = 888 + count; }
static void FillPrm(TCrdPrm *to) { to->evenTime = 33; to->originPos[0] = 44; }
static void Keep(long *what) { kept = what; }
static void Swap(long *a, long *b) { long c = *a; *a = *b; *b = c; }
static long Twice(long of) { g_power++; return 2 * of; }
static int Ready(void) { return readiness++ % 2; }
static void MyGT_CrdClear(short crd, short fifo) {}
static int GT_CrdClearAll;
static void Log(const char *text, ...) {}
static int quiet(const char *text, ...) { return 0; }
static void Sleep(unsigned ms) {}
static void CHECK(short code) {}
static void commandhandler(const char *name, short code) {}

static void Poke(long address) { *(long *)address = 55; }
static void DrawFrame(void) { GT_LnXY(1, 111, 222, 50, 2, 0, 0); }
static void Write(const char *text, ...) { g_power = 66; }

static void Touch(void)
{
    g_power = 63;
    g_pos[0] = 64;
    if (kept)
        *kept = 65;
}

static struct machine {
    short (*GT_CrdClear)(short, short);
    short (*GT_LnXY)(short, long, long, double, double, double, short);
} mc = {GT_CrdClear, GT_LnXY}, *pmc = &mc;

#define printf quiet
#define exit(code) siglongjmp(out_of_text, 1)
#define abort() siglongjmp(out_of_text, 1)
#define assert(what) ((void)0)
#define ASSERT(what) ((void)0)
#define _ASSERTE(what) ((void)0)
#define TRACE(...) ((void)0)
#define FAST 1
#define g_other g_power
#define WHEN(what) if (what)
#define REPEAT(times) for (int at_ = 0; at_ < (times); at_++)
#define LASER_ON GT_BufLaserOn(1, 0, 0);

static void leave(int signal)
{
    siglongjmp(out_of_text, signal == SIGALRM ? 3 : 2);
}

/* Runs a text: undefined behaviour and crashes are signals, and so is a text that takes a second. */
static int run_text(int (*text)(int, char **))
{
    static const int SIGNALS[] = {SIGILL, SIGTRAP, SIGSEGV, SIGBUS, SIGFPE, SIGABRT, SIGALRM};
    enum { COUNT = sizeof SIGNALS / sizeof *SIGNALS };
    struct sigaction old[COUNT], mine = {.sa_handler = leave, .sa_flags = SA_NODEFER};
    struct itimerval second = {.it_value = {.tv_sec = 1}}, none = {0};
    static char *arguments[] = {"text", NULL};
    int at, result;
    set_globals();
    for (at = 0; at < COUNT; at++)
        sigaction(SIGNALS[at], &mine, &old[at]);
    setitimer(ITIMER_REAL, &second, NULL);
    result = sigsetjmp(out_of_text, 1);
    if (result == 0)
        text(1, arguments);
    setitimer(ITIMER_REAL, &none, NULL);
    for (at = 0; at < COUNT; at++)
        sigaction(SIGNALS[at], &old[at], NULL);
    return result < 2 ? RAN : result == 2 ? UNDEFINED : ENDLESS;
}
