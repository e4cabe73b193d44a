"""Sky writing (RTC5): run-ins, run-outs, and laser switches that compensate for the lag of the beam.

    jump          run-in          mark               run-out         jump
............P-->-->-->-->-->S==================E-->-->-->-->-->Q............
            |  v^2/2a  | 10 us * NPREV |       | 10 us * NPOST |  v^2/2a |

add_runs adds the motions, place_switches puts the switches where the beam is; run_field checks the field.
"""
