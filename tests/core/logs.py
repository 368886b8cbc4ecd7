"""Log files as measurement programs, oscilloscopes and controllers write them, rebuilt from their published layouts.

Each gives the same 50 samples: t in s at 1 kHz, u in V, x in mm. `LAYOUTS` holds name -> (file name, text, how the rig
maps time, command and position).
"""

from __future__ import annotations

import numpy as np

N = 50
T = np.arange(N) * 1e-3
U = np.round(2 * np.sin(40 * T) + 0.1, 4)
X = np.round(30 * np.cos(25 * T), 4)


def rows(delimiter=",", comma=False, columns=None, ends="", decimals=4):
    """The samples as lines, with other columns if given (each a function of the row's number, or t, u, x)."""
    lines = []
    for k in range(N):
        known = {"t": f"{T[k]:.6f}", "u": f"{U[k]:.{decimals}f}", "x": f"{X[k]:.{decimals}f}"}
        cells = [known[c] if isinstance(c, str) else str(c(k)) for c in (columns or ("t", "u", "x"))]
        line = delimiter.join(cells) + ends
        lines.append(line.replace(".", ",") if comma else line)
    return lines


def text(*parts, end="\n"):
    return end.join(line for part in parts for line in ([part] if isinstance(part, str) else part)) + end


def stamp(k, form="2024-05-02 10:00:{:06.3f}"):
    return form.format(59.98 + T[k]) if T[k] < 0.02 else form.replace("10:00", "10:01").format(T[k] - 0.02)


SECONDS, MS = ("t", "s"), ("t", "ms")
PLAIN = (("u", "V"), ("x", "mm"))
LAYOUTS = {
    "LeCroy": (
        "C1--trace--00000.csv",
        text(
            "LECROYWR64Xi,12345,Waveform",
            "Segments,1,SegmentSize,50",
            "Segment,TrigTime,TimeSinceSegment1",
            "#1,02-May-2024 10:00:00,0",
            "Time,Ampl,Position",
            rows(),
        ),
        (("Time", "s"), ("Ampl", "V"), ("Position", "mm")),
    ),
    "Tektronix MSO": (
        "tek0000.csv",
        text(
            "Model,MSO54",
            "Firmware Version,1.20.6",
            "",
            "Waveform Type,ANALOG",
            "Point Format,Y",
            "Horizontal Units,s",
            "Horizontal Scale,0.004",
            "Sample Interval,1.0E-3",
            "Record Length,50",
            "Label,,",
            "TIME,CH1,CH2",
            rows(),
        ),
        (("TIME", "s"), ("CH1", "V"), ("CH2", "mm")),
    ),
    "Tektronix TDS": (
        "F0000CH1.CSV",
        text(
            [
                f"{a},{b},,{line},"
                for (a, b), line in zip(
                    [
                        ("Record Length", "5.0e+01"),
                        ("Sample Interval", "1.0e-03"),
                        ("Trigger Point", "2.5e+01"),
                        ("", ""),
                        ("", ""),
                        ("", ""),
                        ("Source", "CH1"),
                        ("Vertical Units", "V"),
                    ]
                    + [("", "")] * (N - 8),
                    rows(),
                    strict=True,
                )
            ]
        ),
        (("column 4", "s"), ("column 5", "V"), ("column 6", "mm")),
    ),
    "Keysight": (
        "scope_0.csv",
        text("x-axis,1,2", "second,Volt,Volt", rows(columns=("t", "u", "x"))),
        (("x-axis", "s"), ("1", "V"), ("2", "mm")),
    ),
    "Rigol": (
        "NewFile1.csv",
        text(
            "X,CH1,CH2,Start,Increment,",
            "Sequence,Volt,Volt,-2.5e-02,1.0e-03",
            rows(columns=(lambda k: k, "u", "x"), ends=",,"),
        ),
        (("X", "s"), ("CH1", "V"), ("CH2", "mm")),
    ),
    "Siglent": (
        "SDS00001.csv",
        text(
            "Record Length,Analog:50",
            "Sample Interval,Analog:0.001",
            "Vertical Units,CH1:V,CH2:V",
            "Model Number,SDS1104X-E",
            "Source,CH1,CH2",
            "Second,Volt,Volt2",
            rows(),
        ),
        (("Second", "s"), ("Volt", "V"), ("Volt2", "mm")),
    ),
    "PicoScope": (
        "20240502-0001.csv",
        text(
            "Time,Channel A,Channel B",
            "(ms),(V),(V)",
            "",
            rows(columns=(lambda k: f"{1e3 * T[k]:.8f}", "u", "x")),
        ),
        (("Time", "ms"), ("Channel A", "V"), ("Channel B", "mm")),
    ),
    "LabVIEW LVM": (
        "run.lvm",
        text(
            "LabVIEW Measurement\t",
            "Writer_Version\t2",
            "Reader_Version\t2",
            "Separator\tTab",
            "Decimal_Separator\t.",
            "Multi_Headings\tNo",
            "X_Columns\tOne",
            "Time_Pref\tRelative",
            "Operator\tme",
            "Date\t2024/05/02",
            "Time\t10:00:00.1234567",
            "***End_of_Header***\t",
            "\t",
            "Channels\t2\t\t",
            "Samples\t50\t50\t",
            "Date\t2024/05/02\t2024/05/02\t",
            "Time\t10:00:00.1\t10:00:00.1\t",
            "Y_Unit_Label\tVolts\tMillimeters\t",
            "X_Dimension\tTime\tTime\t",
            "X0\t0.0E+0\t0.0E+0\t",
            "Delta_X\t0.001000\t0.001000\t",
            "***End_of_Header***\t\t\t",
            "X_Value\tVoltage\tPosition\tComment",
            rows("\t", columns=("t", "u", "x")),
        ),
        (("X_Value", "s"), ("Voltage", "V"), ("Position", "mm")),
    ),
    "LabVIEW LVM, one time a channel": (
        "run.lvm",
        text(
            "LabVIEW Measurement\t",
            "X_Columns\tMulti",
            "***End_of_Header***\t",
            "Channels\t2\t\t",
            "***End_of_Header***\t\t\t",
            "X_Value\tVoltage\tX_Value\tPosition\tComment",
            rows("\t", columns=("t", "u", "t", "x")),
        ),
        (("X_Value", "s"), ("Voltage", "V"), ("Position", "mm")),
    ),
    "HBM catman": (
        "catman.txt",
        text(
            "HBM_CATMAN_DATAFILE_40",
            "T0 = 02.05.2024 10:00:00",
            "NUMBER OF CHANNELS\t3",
            "",
            "Zeit  1 - Standardmessrate\tMX840_CH 1\tMX840_CH 2",
            "s\tV\tmm",
            "LINEAR\tLINEAR\tLINEAR",
            rows("\t", comma=True),
        ),
        (("Zeit  1 - Standardmessrate", "s"), ("MX840_CH 1", "V"), ("MX840_CH 2", "mm")),
    ),
    "Dewesoft": (
        "dewesoft.txt",
        text(
            "Data file;C:\\data\\run.d7d",
            "Sample rate;1000 Hz",
            "Start time;02.05.2024 10:00:00.000",
            "Events",
            "Event Type;Event;Time",
            "1;storing started at;0.000",
            "",
            "Time (s);AI 1/u (V);AI 2/x (mm)",
            rows(";"),
        ),
        (("Time (s)", "s"), ("AI 1/u (V)", "V"), ("AI 2/x (mm)", "mm")),
    ),
    "TwinCAT Scope": (
        "scope.csv",
        text(
            "Name\taxis",
            "File\tC:\\axis.csv",
            "Starttime of export\t132959733843760000\tMontag, 2. Mai 2022",
            "",
            "",
            "Name\tu\tName\tx",
            "SymbolComment\t\tSymbolComment\t",
            "Data-Type\tREAL64\tData-Type\tREAL64",
            "SampleTime[ms]\t1\tSampleTime[ms]\t1",
            "Unit\t(None)\tUnit\tmm (Length)",
            "",
            rows("\t", comma=True, columns=(lambda k: k, "u", lambda k: k, "x")),
        ),
        (None, ("u", "V"), ("x", "mm")),
    ),
    "Siemens Startdrive trace": (
        "trace.csv",
        text(
            "SINAMICS trace",
            "Project;Axis",
            "Sampling;1 ms",
            "",
            '"Time [ms]";"r62: Drehzahlsollwert [V]";"r4[0]: Lageistwert [mm]"',
            rows(";", comma=True, columns=(lambda k: f"{k}.000000", "u", "x")),
        ),
        (("Time [ms]", "ms"), ("r62: Drehzahlsollwert [V]", "V"), ("r4[0]: Lageistwert [mm]", "mm")),
    ),
    "TIA Portal trace": (
        "tia.csv",
        text(
            "sep=;",
            "Trace;MyTrace",
            "Timestamp;Sample;DB1.u;DB1.x",
            rows(";", columns=(stamp, lambda k: k, "u", "x")),
        ),
        (("Timestamp", "s"), ("DB1.u", "V"), ("DB1.x", "mm")),
    ),
    "Rockwell trend": (
        "trend.csv",
        text(
            '"Header:","Version 20"',
            '"Controller Name:","PLC"',
            '"Trend Name:","T1"',
            '"Sample Period:","1","ms"',
            '"Header:","Date","Time","Program:Main.u","Program:Main.x"',
            rows(
                columns=(
                    lambda k: '"Data"',
                    lambda k: '"05/02/2024"',
                    lambda k: f'"10:00:00;{k:03d}"',
                    "u",
                    "x",
                )
            ),
        ),
        (("Time", "s"), ("Program:Main.u", "V"), ("Program:Main.x", "mm")),
    ),
    "B&R Automation Studio": (
        "br.csv",
        text(
            "B&R Automation Studio trace",
            "Time;gAxis.u;gAxis.x",
            "[us];[V];[mm]",
            rows(";", columns=(lambda k: 1000 * k, "u", "x")),
        ),
        (("Time", "us"), ("gAxis.u", "V"), ("gAxis.x", "mm")),
    ),
    "ROS 1 bag": (
        "topic.csv",
        text(
            "%time,field.header.seq,field.header.frame_id,field.u,field.x",
            rows(
                columns=(lambda k: 1423155837204827070 + 10**6 * k, lambda k: k, lambda k: "base", "u", "x")
            ),
        ),
        (("%time", "ns"), ("field.u", "V"), ("field.x", "mm")),
    ),
    "PlotJuggler of ROS 2": (
        "plot.csv",
        text("__time,/axis/u,/axis/x", rows(columns=(lambda k: f"{1714644000.25 + T[k]:.6f}", "u", "x"))),
        (("__time", "s"), ("/axis/u", "V"), ("/axis/x", "mm")),
    ),
    "ros2 topic echo --csv": (
        "echo.csv",
        text(rows(columns=(lambda k: 1714644000, lambda k: 10**6 * k, lambda k: "base", "u", "x"))),
        (("column 2", "ns"), ("column 4", "V"), ("column 5", "mm")),
    ),
    "dSPACE ControlDesk": (
        "rec1.csv",
        text(
            "descriptor,,,",
            "name,Model Root/time,Model Root/u,Model Root/x",
            "unit,s,V,mm",
            "type,float64,float64,float64",
            rows(columns=(lambda k: "trace_values" if k == 0 else "", "t", "u", "x")),
        ),
        (("Model Root/time", "s"), ("Model Root/u", "V"), ("Model Root/x", "mm")),
    ),
    "Vector CANape": (
        "canape.csv",
        text("Comment;exported by CANape", "Time[s];Drive.u[V];Drive.x[mm]", rows(";")),
        (("Time", "s"), ("Drive.u", "V"), ("Drive.x", "mm")),
    ),
    "Yokogawa": (
        "dl850.csv",
        text(
            '"HEADER SIZE","8"',
            '"Model","DL850"',
            '"BlockNumber","1"',
            '"VUnit","V","V"',
            '"HResolution","0.001"',
            '"Date","2024/05/02"',
            "",
            '"Time","CH1","CH2"',
            rows(columns=("t", "u", "x"), ends=","),
        ),
        (("Time", "s"), ("CH1", "V"), ("CH2", "mm")),
    ),
    "HIOKI": (
        "hioki.csv",
        text(
            '"HIOKI 8847","V2.10"',
            '"Trigger time","24-05-02 10:00:00"',
            '"Time","CH1-1[V]","CH1-2[mm]"',
            rows(),
        ),
        (("Time", "s"), ("CH1-1[V]", "V"), ("CH1-2[mm]", "mm")),
    ),
    "iba": (
        "iba.txt",
        text("ibaAnalyzer text export", "time\t[0:0] u\t[0:1] x", "sec\tV\tmm", rows("\t")),
        (("time", "s"), ("[0:0] u", "V"), ("[0:1] x", "mm")),
    ),
    "drive commissioning tool": (
        "epos.csv",
        text(
            "# maxon EPOS Studio recorder",
            "# node 1",
            "Time [ms];Current demand [mA];Position actual [inc]",
            rows(";", columns=(lambda k: f"{1e3 * T[k]:.1f}", "u", "x")),
            "# end of data",
        ),
        (("Time [ms]", "ms"), ("Current demand [mA]", "V"), ("Position actual [inc]", "mm")),
    ),
    "MATLAB writematrix with a comment head": (
        "matlab.txt",
        text("% t u x", rows("  ")),
        (SECONDS, *PLAIN),
    ),
    "fixed width with blanks in names": (
        "fixed.prn",
        text(
            "  Time (s)     Valve cmd     Position 1",
            "  --------     ---------     ----------",
            [f"{a:>10}{b:>14}{c:>15}" for a, b, c in (line.split(",") for line in rows())],
        ),
        (("Time (s)", "s"), ("Valve cmd", "V"), ("Position 1", "mm")),
    ),
    "German, date and time apart": (
        "log.csv",
        text(
            "Datum;Uhrzeit;Kommentar;u;x",
            [
                f"02.05.2024;10:00:00,{k:03d};ok, läuft;{line}"
                for k, line in enumerate(rows(";", comma=True, columns=("u", "x")))
            ],
        ),
        (("Uhrzeit", "s"), *PLAIN),
    ),
    "German stamps over midnight": (
        "log.csv",
        text(
            "Zeitstempel;u;x",
            [
                f"{'02.05.2024 23:59:59' if k < 20 else '03.05.2024 00:00:00'},{(980 + k) % 1000:03d};{line}"
                for k, line in enumerate(rows(";", comma=True, columns=("u", "x")))
            ],
        ),
        (("Zeitstempel", "s"), *PLAIN),
    ),
    "American stamps": (
        "log.csv",
        text(
            "Date/Time,u,x",
            [
                f"5/2/2024 {'11:59:59' if k < 20 else '12:00:00'}.{(980 + k) % 1000:03d} {'AP'[k >= 20]}M,{line}"
                for k, line in enumerate(rows(columns=("u", "x")))
            ],
        ),
        (("Date/Time", "s"), *PLAIN),
    ),
    "ISO stamps with a zone": (
        "log.csv",
        text(
            "t,u,x",
            [f"2024-05-02T10:00:00.{k:03d}+02:00,{line}" for k, line in enumerate(rows(columns=("u", "x")))],
        ),
        (SECONDS, *PLAIN),
    ),
    "quoted decimal commas between commas": (
        "log.csv",
        text(
            "t,u,x", [",".join(f'"{cell.replace(".", ",")}"' for cell in line.split(",")) for line in rows()]
        ),
        (SECONDS, *PLAIN),
    ),
    "statistics below the table": (
        "log.csv",
        text("t;u;x", rows(";"), "", "Mean;0.1;0.5", "Maximum;2.1;30"),
        (SECONDS, *PLAIN),
    ),
}
