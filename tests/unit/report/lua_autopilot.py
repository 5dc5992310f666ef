"""As much of ArduPilot's scripting interface as the scripts of a plan use, with a clock that the test turns."""

from __future__ import annotations

from typing import Any

import pytest

_INTERFACE = r"""
state = { now = 0, mode = 5, armed = true, flying = true, switch = 0, position = { 0, 0, -20 }, yaw = 0.5,
          velocity = { 0, 0, 0 }, roll = 0, pitch = 0, home_down = 0, refuse_mode = nil, refuse_parameter = nil,
          version = 47 }
parameters = {}
events, targets, texts = {}, {}, {}

local clock = {}
clock.__index = clock
clock.__sub = function(a, b) return setmetatable({ v = a.v - b.v }, clock) end
function clock:tofloat() return self.v end
function millis() return setmetatable({ v = state.now }, clock) end

local vector = {}
vector.__index = vector
function vector:x() return self[1] end
function vector:y() return self[2] end
function vector:z() return self[3] end

gcs = {}
function gcs:send_text(severity, text) texts[#texts + 1] = text end
vehicle = {}
function vehicle:get_mode() return state.mode end
-- Copter::set_mode and ModeSystemId::init in flight, by version: 45 enters from any mode; since 46 axes 1 to 13 need a
-- mode with manual throttle (Stabilize, Acro, SystemID), and there are axes 14 to 19, which need Loiter.
local MANUAL = { [0] = true, [1] = true, [25] = true }
local function refused(mode)
    if mode == state.mode then return nil end
    if mode == 5 and not state.position then return "requires position" end
    if mode ~= 25 then return nil end
    local axis = parameters.SID_AXIS or 0
    if axis == 0 then return "No axis selected, SID_AXIS = 0" end
    if state.version < 46 then
        return axis > 13 and "no such axis" or nil
    end
    if not state.armed or not state.flying then return "Aircraft must be flying" end
    if axis <= 13 and not MANUAL[state.mode] then return "Axis requires manual throttle" end
    if axis > 13 and state.mode ~= 5 then return "Axis requires switch from Loiter" end
end
function vehicle:set_mode(mode)
    if mode == state.refuse_mode then return false end
    local reason = refused(mode)
    if reason then
        texts[#texts + 1] = reason
        return false
    end
    state.mode = mode
    events[#events + 1] = { state.now, "mode", mode }
    return true
end
function vehicle:get_likely_flying() return state.flying end
function vehicle:set_target_angle_and_climbrate(roll, pitch, yaw, climb, use_rate, rate)
    if state.mode ~= 4 then return false end
    targets[#targets + 1] = { state.now, roll, pitch, yaw, climb }
    return true
end
arming = {}
function arming:is_armed() return state.armed end
ahrs = {}
function ahrs:get_relative_position_NED_origin()
    if not state.position then return nil end
    return setmetatable({ state.position[1], state.position[2], state.position[3] }, vector)
end
function ahrs:get_relative_position_NED_home()
    if not state.position then return nil end
    return setmetatable({ state.position[1], state.position[2], state.position[3] - state.home_down }, vector)
end
function ahrs:get_velocity_NED()
    if not state.velocity then return nil end
    return setmetatable({ state.velocity[1], state.velocity[2], state.velocity[3] }, vector)
end
function ahrs:get_roll_rad() return state.roll end
function ahrs:get_pitch_rad() return state.pitch end
function ahrs:get_yaw_rad() return state.yaw end
param = {}
function param:set(name, value)
    if name == state.refuse_parameter then return false end
    parameters[name] = value
    events[#events + 1] = { state.now, name, value }
    return true
end
rc = {}
local switch = {}
function switch:get_aux_switch_pos() return state.switch end
function rc:find_channel_for_option(option) if option == 300 then return switch end end
"""


class Autopilot:
    """Runs a script as the scheduler of ArduPilot does: it calls what the last call returned, after so many ms."""

    def __init__(self, script: str, files: dict[str, str] | None = None) -> None:
        lupa = pytest.importorskip("lupa", reason="lupa, which runs Lua scripts, is not installed")
        self.lua = lupa.LuaRuntime(unpack_returned_tuples=True)
        self.lua.execute(_INTERFACE)
        self.globals = self.lua.globals()
        self._install(files or {})
        self.update, self.period_ms = self.lua.execute(script)

    def _install(self, files: dict[str, str]) -> None:
        self.globals.contents = self.lua.table_from(files)
        self.lua.execute(
            r"""
            io.open = function(path, mode)
                local text = contents[path]
                if not text then return nil end
                local next_line = string.gmatch(text, "([^\n]*)\n")
                return { read = function() return next_line() end, close = function() end }
            end
            """
        )

    @property
    def state(self) -> Any:
        return self.globals.state

    def run(self, seconds: float) -> None:
        until = self.state.now + 1000.0 * seconds
        while self.state.now + self.period_ms <= until:
            self.state.now += self.period_ms
            self.update, self.period_ms = self.update()
        self.state.now = until

    def events(self) -> list[tuple[float, str, float]]:
        return [tuple(one.values()) for one in self.globals.events.values()]

    def targets(self) -> list[tuple[float, ...]]:
        return [tuple(one.values()) for one in self.globals.targets.values()]

    def texts(self) -> list[str]:
        return list(self.globals.texts.values())
