#include <stdio.h>
#include "gts.h"

static void frame(long size)
{
    GT_LnXY(1, size, 0, 50, 2, 0, 0);
    GT_LnXY(1, size, size, 50, 2, 0, 0);
    GT_LnXY(1, 0, size, 50, 2, 0, 0);
    GT_LnXY(1, 0, 0, 50, 2, 0, 0);
}

int main(void)
{
    int i;
    if (GT_Open(0, 1) != 0)
        return 1;
    for (i = 1; i <= 10; i++)
        frame(1000 * i);
    GT_CrdStart(1, 0);
    return 0;
}
