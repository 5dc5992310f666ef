-- {{ plan }}, {{ vehicle }}: flies the attitudes of {{ table }} in GUIDED mode.
-- ArduPilot Copter 4.5 or later with SCR_ENABLE = 1; put this file and {{ table }} into APM/scripts on the card
-- and reboot. If memory is short, raise SCR_HEAP_SIZE.
--
-- The pilot takes off, hovers in LOITER in the middle of the room, switches to GUIDED, and turns on the switch whose
-- RCx_OPTION is 300 (Scripting1). The script asks for the attitudes of the table, added to level and to the heading of
-- the start, and for no climb: height is held, position is not, and the vehicle drifts with the wind.
-- The attitude controller smooths what it is asked for (ATC_INPUT_TC): the log's set-points are what was flown.
--
-- The pilot has the last word: any change of the flight mode by the pilot ends the plan, and so does turning the switch
-- off. The script never arms, never disarms and never touches the sticks.
-- When it ends by itself or at a limit it enters LOITER.

local GUIDED, LOITER = 4, 5
local TABLE = "/APM/scripts/{{ table }}"
local ROWS = {{ rows }}
local ROW_S = {{ number(1.0 / rate_hz) }}
local PERIOD_MS = {{ number(1000.0 / rate_hz) }}
local ROOM_M = {{ number(facts.stop_room_m) }} -- horizontal distance from the start that ends the plan
local CLIMB_M = {{ number(facts.stop_climb_m) }} -- departure from the height of the start that ends the plan
local LARGEST_DEG = { {{ number(largest_deg[0]) }}, {{ number(largest_deg[1]) }}, {{ number(largest_deg[2]) }} }
-- A row of the table beyond these, or one that is no number, ends the plan.

local WAITING, FLYING, OVER = 0, 1, 2
local state = OVER -- until the switch was seen off: a switch that is on at boot starts nothing
local since = millis()
local origin = nil
local heading_deg = 0
local file = nil
local row = 0
local angles = { 0, 0, 0 }

local switch = assert(rc:find_channel_for_option(300), "rotorid: no switch has RCx_OPTION 300")

local function say(text)
    gcs:send_text(6, "rotorid: " .. text)
end

local function yaw_deg()
    -- The name changed between 4.6 and 4.7.
    local found, yaw = pcall(function() return ahrs:get_yaw_rad() end)
    if not found or not yaw then
        yaw = ahrs:get_yaw()
    end
    return math.deg(yaw)
end

local function outside()
    local position = ahrs:get_relative_position_NED_origin()
    if not position or not origin then
        return "no position"
    end
    local north = position:x() - origin:x()
    local east = position:y() - origin:y()
    if not (math.sqrt(north * north + east * east) <= ROOM_M) then -- also when it is no number
        return "out of the room"
    end
    if not (math.abs(position:z() - origin:z()) <= CLIMB_M) then
        return "height"
    end
    return nil
end

local function finish(reason)
    if file then
        file:close()
        file = nil
    end
    if state == FLYING and vehicle:get_mode() == GUIDED then
        vehicle:set_mode(LOITER)
    end
    say(reason)
    state = OVER
end

local function read_row()
    local line = file:read()
    local index = 0
    for cell in string.gmatch(line or "", "[^,]+") do
        index = index + 1
        local value = tonumber(cell)
        if index > 3 or not value or math.abs(value) > LARGEST_DEG[index] + 0.01 then
            return false
        end
        angles[index] = value
    end
    row = row + 1
    return index == 3
end

local function fly()
    if vehicle:get_mode() ~= GUIDED then
        finish("the pilot took over")
        return
    end
    local wanted = math.floor((millis() - since):tofloat() * 0.001 / ROW_S + 0.5) + 1 -- the nearest row
    if wanted > ROWS then
        finish("plan complete")
        return
    end
    while row < wanted do
        if not read_row() then
            finish("the table is damaged")
            return
        end
    end
    local heading = (heading_deg + angles[3]) % 360
    if not vehicle:set_target_angle_and_climbrate(angles[1], angles[2], heading, 0, false, 0) then
        finish("the attitude was refused")
    end
end

local function start()
    origin = ahrs:get_relative_position_NED_origin()
    file = io.open(TABLE, "r")
    row = 0
    since = millis()
    if not arming:is_armed() or not vehicle:get_likely_flying() then
        finish("not flying")
    elseif vehicle:get_mode() ~= GUIDED then
        finish("begin in GUIDED")
    elseif not origin then
        finish("no position")
    elseif not file then
        finish("no table " .. TABLE)
    else
        heading_deg = yaw_deg()
        say("plan begins")
        state = FLYING
        fly()
    end
end

local function update()
    local on = switch:get_aux_switch_pos() == 2
    if not on then
        if state == FLYING then
            finish("switched off")
        end
        state = WAITING
    elseif state == WAITING then
        start()
    elseif state == FLYING then
        local reason = not arming:is_armed() and "disarmed" or outside()
        if reason then
            finish(reason)
        else
            fly()
        end
    end
    return update, PERIOD_MS
end

say(string.format("plan of %.0f s loaded", ROWS * ROW_S))
return update, 1000
