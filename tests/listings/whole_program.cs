using System;
using System.Runtime.InteropServices;

namespace Marking
{
    public partial class MainForm : Form
    {
        [DllImport("gts.dll")]
        private static extern short GT_LnXY(short crd, int x, int y, double v, double a, double e, short fifo);

        private void Start_Click(object sender, EventArgs e)
        {
            for (int i = 0; i < rows.Count; i++)
            {
                GT_LnXY(1, rows[i].X, rows[i].Y, 50, 2, 0, 0);
            }
        }
    }
}
