"""What the messages of ArduPilot Copter look like: numbers, letters, columns, units and multipliers of firmware 4.5 on.

Taken from the definitions in logs of the firmware itself. ``RATE.ADes`` and ``RATE.A`` are centimeters per second
squared, upward; angles of heading run from 0 to 360 degrees.
"""

from __future__ import annotations

from collections.abc import Mapping
from types import MappingProxyType

from rotorid.io.dataflash_write import Layout

_CHANNELS = "TimeUS," + ",".join(f"C{number}" for number in range(1, 15))
_ANGLES = "TimeUS,DesRoll,Roll,DesPitch,Pitch,DesYaw,Yaw"

_TABLE = (
    Layout(number=32, name="PARM", letters="QNff", columns="TimeUS,Name,Value,Default", units="s---",
           multipliers="F---", absent=frozenset({"Default"})),
    Layout(number=59, name="MSG", letters="QZ", columns="TimeUS,Message", units="s-", multipliers="F-"),
    Layout(number=186, name="ARM", letters="QBIBB", columns="TimeUS,ArmState,ArmChecks,Forced,Method", units="s----",
           multipliers="F----"),
    Layout(number=181, name="EV", letters="QB", columns="TimeUS,Id", units="s-", multipliers="F-"),
    Layout(number=10, name="SIDS", letters="QBfffffff", columns="TimeUS,Ax,Mag,FSt,FSp,TFin,TC,TR,TFout",
           units="s--ssssss", multipliers="F--------"),
    Layout(number=120, name="MODE", letters="QMBB", columns="TimeUS,Mode,ModeNum,Rsn", units="s---",
           multipliers="F---"),
    Layout(number=195, name="ANG", letters="Qfffffff", columns=f"{_ANGLES},Dt", units="sddddhhs",
           multipliers="F0000000"),
    Layout(number=75, name="RATE", letters="Qfffffffffffff",
           columns="TimeUS,RDes,R,ROut,PDes,P,POut,YDes,Y,YOut,ADes,A,AOut,AOutSlew", units="skk-kk-kk-oo--",
           multipliers="F?????????BB--"),
    Layout(number=9, name="SIDD", letters="Qfffffffff", columns="TimeUS,Time,Targ,F,Gx,Gy,Gz,Ax,Ay,Az",
           units="ss-zkkkooo", multipliers="F---------"),
    Layout(number=163, name="IMU", letters="QBffffffIIfBBHH",
           columns="TimeUS,I,GyrX,GyrY,GyrZ,AccX,AccY,AccZ,EG,EA,T,GH,AH,GHz,AHz", units="s#EEEooo--O--zz",
           multipliers="F-000000-----00"),
    Layout(number=44, name="XKF1", letters="QBccCfffffffccce",
           columns="TimeUS,C,Roll,Pitch,Yaw,VN,VE,VD,dPD,PN,PE,PD,GX,GY,GZ,OH", units="s#ddhnnnnmmmkkkm",
           multipliers="F-BBB0000000BBBB"),
    Layout(number=88, name="BAT", letters="QBfffffcfBBB",
           columns="TimeUS,Inst,Volt,VoltR,Curr,CurrTot,EnrgTot,Temp,Res,RemPct,H,SH", units="s#vvAaXOw%-%",
           multipliers="F-000C0?0000"),
    Layout(number=0, name="CTUN", letters="Qffffffefffhh",
           columns="TimeUS,ThI,ABst,ThO,ThH,DAlt,Alt,BAlt,DSAlt,SAlt,TAlt,DCRt,CRt", units="s----mmmmmmnn",
           multipliers="F----00B000BB", absent=frozenset({"DSAlt"})),
    Layout(number=72, name="ATT", letters="QffffffB", columns=f"{_ANGLES},AEKF", units="sddddhh-",
           multipliers="F000000-"),
    Layout(number=205, name="MOTB", letters="QfffffB",
           columns="TimeUS,LiftMax,BatVolt,ThLimit,ThrAvMx,ThrOut,FailFlags", units="s------",
           multipliers="F------"),
    Layout(number=60, name="RCIN", letters="QHHHHHHHHHHHHHH", columns=_CHANNELS, units="sYYYYYYYYYYYYYY",
           multipliers="F--------------"),
    Layout(number=62, name="RCOU", letters="QHHHHHHHHHHHHHH", columns=_CHANNELS, units="sYYYYYYYYYYYYYY",
           multipliers="F--------------"),
)  # fmt: skip

LAYOUTS: Mapping[str, Layout] = MappingProxyType({layout.name: layout for layout in _TABLE})
"""Name to layout, in the order in which ArduPilot writes messages of one instant."""
