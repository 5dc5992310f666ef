-- {{ plan }}, {{ vehicle }}: flies the attitudes of {{ table }} in GUIDED mode.
-- For ArduPilot Copter {{ versions }} with SCR_ENABLE = 1; put this file and {{ table }} into APM/scripts on the card
-- and reboot. If memory is short, raise SCR_HEAP_SIZE.
--
-- The pilot takes off, hovers in LOITER in the middle of the room, switches to GUIDED, and turns on the switch whose
-- RCx_OPTION is 300 (Scripting1). The script sends the attitudes of the table, added to the heading at the start and to
-- the lean of a slow position loop, as in the simulation that gave the limits of the flight. It sends no climb: the
-- autopilot controls the throttle and keeps the height.
-- The attitude controller smooths these set-points (ATC_INPUT_TC); the log has the smoothed ones.
--
-- To stop: {{ stop }}. Any other change of the flight mode ends the plan too, and so does turning the switch off. The script never arms, never disarms and never touches the sticks.
-- At its end or at a limit it switches to LOITER.

local GUIDED, LOITER = 4, 5
local TABLE = "/APM/scripts/{{ table }}"
local ROWS = {{ rows }}
local ROW_S = {{ number(1.0 / rate_hz) }}
local PERIOD_MS = {{ number(1000.0 / rate_hz) }}
local ROOM_M = {{ number(facts.stop_room_m) }} -- horizontal distance from the start that ends the plan
local CLIMB_M = {{ number(facts.stop_climb_m) }} -- height change that ends the plan
local LARGEST_DEG = { {{ largest_deg | join(", ") }} }
-- A table row beyond these, or one that is not a number, ends the plan.
local LEAST_HEIGHT_M = {{ number(facts.least_height_m) }} -- above home, to start

-- Position loop: acceleration per drift (1/s) and per its integral (1/s^2), speed per distance (1/s).
local SPEED_GAIN, INTEGRAL_GAIN, PLACE_GAIN = {{ number(hold.speed) }}, {{ number(hold.integral) }}, {{ number(hold.place) }}
local GRAVITY = {{ number(gravity) }}
local MOST = GRAVITY * math.tan(math.rad({{ number(hold.lean_deg) }})) -- acceleration of the largest added lean
local TRIM_S = 2.0 -- the mean lean of this time before the start compensates the wind
local LONGEST_STEP_S = 0.1

local WAITING, FLYING, OVER = 0, 1, 2
local state = OVER -- until the switch was seen off: a switch that is on at boot starts nothing
local since = millis()
local origin = nil
local heading_deg = 0
local file = nil
local row = 0
local angles = { 0, 0, 0 }
local wind_north, wind_east = 0, 0 -- acceleration that keeps the vehicle at its place
local seen = 0
local held = nil -- when the hold last looked

local switch = assert(rc:find_channel_for_option(300), "rotorid: no switch has RCx_OPTION 300")

local function say(text)
    gcs:send_text(6, "rotorid: " .. text)
end

-- The names changed between 4.6 and 4.7.
local in_radians = pcall(function() return ahrs:get_yaw_rad() end)

local function attitude()
    if in_radians then
        return ahrs:get_roll_rad(), ahrs:get_pitch_rad(), ahrs:get_yaw_rad()
    end
    return ahrs:get_roll(), ahrs:get_pitch(), ahrs:get_yaw()
end

local function shorter(acceleration)
    -- No number is none.
    return acceleration == acceleration and math.min(math.max(acceleration, -MOST), MOST) or 0
end

local function watch()
    -- While the autopilot still holds its place: what it leans for that.
    local roll, pitch, yaw = attitude()
    local ahead, right = -GRAVITY * math.tan(pitch), GRAVITY * math.tan(roll)
    local north = math.cos(yaw) * ahead - math.sin(yaw) * right
    local east = math.sin(yaw) * ahead + math.cos(yaw) * right
    seen = seen + 1
    local share = math.max(1 / seen, ROW_S / TRIM_S)
    wind_north = shorter(wind_north + share * (north - wind_north))
    wind_east = shorter(wind_east + share * (east - wind_east))
end

local function lean()
    -- Degrees of roll and pitch that lead back to the place of the start; nothing where that is not known.
    local position, velocity = ahrs:get_relative_position_NED_origin(), ahrs:get_velocity_NED()
    if not position or not velocity then
        return nil
    end
    local north = PLACE_GAIN * (origin:x() - position:x()) - velocity:x()
    local east = PLACE_GAIN * (origin:y() - position:y()) - velocity:y()
    local now = millis()
    local step_s = held and math.min((now - held):tofloat() * 0.001, LONGEST_STEP_S) or 0
    held = now
    local wanted_north, wanted_east = SPEED_GAIN * north + wind_north, SPEED_GAIN * east + wind_east
    local size = math.sqrt(wanted_north * wanted_north + wanted_east * wanted_east)
    if not (size < math.huge) then -- also when it is no number
        return nil
    end
    if size <= MOST then
        -- An integral that leans cannot follow would only have to be taken back.
        wind_north = wind_north + INTEGRAL_GAIN * step_s * north
        wind_east = wind_east + INTEGRAL_GAIN * step_s * east
    else
        wanted_north, wanted_east = wanted_north * MOST / size, wanted_east * MOST / size
    end
    local _, _, yaw = attitude()
    local ahead = math.cos(yaw) * wanted_north + math.sin(yaw) * wanted_east
    local right = -math.sin(yaw) * wanted_north + math.cos(yaw) * wanted_east
    return math.deg(math.atan(right / GRAVITY)), -math.deg(math.atan(ahead / GRAVITY))
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
    local roll, pitch = lean()
    if not roll then
        finish("no velocity")
        return
    end
    local heading = (heading_deg + angles[3]) % 360
    if not vehicle:set_target_angle_and_climbrate(roll + angles[1], pitch + angles[2], heading, 0, false, 0) then
        finish("the attitude was refused")
    end
end

local function start()
    origin = ahrs:get_relative_position_NED_origin()
    file = io.open(TABLE, "r")
    row = 0
    since = millis()
    held = nil
    local home = ahrs:get_relative_position_NED_home()
    if not arming:is_armed() or not vehicle:get_likely_flying() then
        finish("not flying")
    elseif vehicle:get_mode() ~= GUIDED then
        finish("begin in GUIDED")
    elseif not origin or not home then
        finish("no position")
    elseif not (-home:z() >= LEAST_HEIGHT_M) then
        finish(string.format("begin above %g m", LEAST_HEIGHT_M))
    elseif not file then
        finish("no table " .. TABLE)
    else
        local _, _, yaw = attitude()
        heading_deg = math.deg(yaw)
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
        if state ~= WAITING then
            seen, wind_north, wind_east = 0, 0, 0
        end
        state = WAITING
        watch()
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
