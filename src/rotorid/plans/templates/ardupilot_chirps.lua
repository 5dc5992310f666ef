-- {{ plan }}, {{ vehicle }}: flies all chirps of the plan in one flight.
-- For ArduPilot Copter {{ versions }} with SCR_ENABLE = 1; put this file into APM/scripts on the card and reboot.
--
-- The pilot takes off, hovers in {{ start.name }} in the middle of the room, and turns on the switch whose RCx_OPTION is
-- 300 (Scripting1). For every chirp the script sets the SID_ parameters and enters SYSTEMID mode; between them it
-- returns to {{ start.name }}, so that the pilot can fly back to the middle; outside the room it waits.
{% if throttle == "pilot" %}
-- The pilot controls the throttle all the time: in {{ start.name }} and SYSTEMID mode the stick is the thrust, near
-- the middle in hover.
{% else %}
-- The autopilot controls the throttle and keeps the height; sticks are ignored during a chirp.
{% endif %}
-- Start in {{ start.name }} ({{ reason }}).
--
-- To stop: {{ stop }}. Any other change of the flight mode ends the plan too, and so does turning the switch off (in {{ start.words }}).
-- At a limit the script ends the plan in {{ loiter.words }}. It never arms, never disarms and never touches the sticks.
-- Parameters are not saved.

local SYSTEMID, {{ loiter.name }} = {{ mode }}, {{ loiter.number }}
local START_MODES = { [{{ start.number }}] = true } -- {{ start.name }}
local ROOM_M = {{ number(facts.stop_room_m) }} -- horizontal distance from the start that ends the plan
local CLIMB_M = {{ number(facts.stop_climb_m) }} -- height change that ends the plan
local LEAST_HEIGHT_M = {{ number(facts.least_height_m) }} -- above home, to start
local PERIOD_MS = 50
local MARGIN_S = 0.5 -- in the mode after the end of a chirp

local RUNS = {
{% for axis, length_s, settings in runs %}
    { axis = "{{ axis }}", length_s = {{ number(length_s) }}, rest_s = {{ number(rests[loop.index0]) }}, settings = {
{% for name, value in settings %}
        { "{{ name }}", {{ value }} },
{% endfor %}
    } },
{% endfor %}
}

local WAITING, RESTING, FLYING, OVER = 0, 1, 2, 3
local state = OVER -- until the switch was seen off: a switch that is on at boot starts nothing
local run = 0
local since = millis()
local home_mode = nil
local origin = nil
local called = false -- whether the pilot was asked to come back in this rest

local switch = assert(rc:find_channel_for_option(300), "rotorid: no switch has RCx_OPTION 300")

local function say(text)
    gcs:send_text(6, "rotorid: " .. text)
end

local function enter(new_state)
    state = new_state
    since = millis()
end

local function elapsed_s()
    return (millis() - since):tofloat() * 0.001
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

local function finish(reason, mode)
    if state == FLYING and vehicle:get_mode() == SYSTEMID and not (mode and vehicle:set_mode(mode)) then
        vehicle:set_mode(home_mode)
    end
    say(reason)
    enter(OVER)
end

local function begin_run()
    for _, setting in ipairs(RUNS[run].settings) do
        if not param:set(setting[1], setting[2]) then
            finish("cannot set " .. setting[1])
            return
        end
    end
    if not vehicle:set_mode(SYSTEMID) then
        finish("SYSTEMID mode was refused")
        return
    end
    say(string.format("chirp %d of %d, %s", run, #RUNS, RUNS[run].axis))
    enter(FLYING)
end

local function start()
    home_mode = vehicle:get_mode()
    origin = ahrs:get_relative_position_NED_origin()
    local home = ahrs:get_relative_position_NED_home()
    if not arming:is_armed() or not vehicle:get_likely_flying() then
        finish("not flying")
    elseif not START_MODES[home_mode] then
        finish("begin in {{ start.name }}")
    elseif not origin or not home then
        finish("no position")
    elseif not (-home:z() >= LEAST_HEIGHT_M) then
        finish(string.format("begin above %g m", LEAST_HEIGHT_M))
    else
        run = 1
        begin_run()
    end
end

local function fly()
    if vehicle:get_mode() ~= SYSTEMID then
        finish("the pilot took over")
        return
    end
    if elapsed_s() < RUNS[run].length_s + MARGIN_S then
        return
    end
    vehicle:set_mode(home_mode)
    if run == #RUNS then
        say("plan complete")
        enter(OVER)
    else
        called = false
        say(string.format("rest %.0f s", RUNS[run].rest_s))
        enter(RESTING)
    end
end

local function rest()
    if vehicle:get_mode() ~= home_mode then
        finish("the pilot took over")
        return
    end
    local reason = outside()
    if reason then
        -- The pilot flies: nothing to break off, and the rest begins when the vehicle is back.
        since = millis()
        if not called then
            say("come back: " .. reason)
            called = true
        end
    elseif elapsed_s() >= RUNS[run].rest_s then
        run = run + 1
        begin_run()
    end
end

local function update()
    local on = switch:get_aux_switch_pos() == 2
    if not on then
        if state == FLYING or state == RESTING then
            finish("switched off")
        end
        state = WAITING
    elseif state == WAITING then
        start()
    elseif state == FLYING or state == RESTING then
        if not arming:is_armed() then
            finish("disarmed")
        elseif state == RESTING then
            rest()
        else
            local reason = outside()
            if reason then
                finish(reason, {{ loiter.name }})
            else
                fly()
            end
        end
    end
    return update, PERIOD_MS
end

say(string.format("plan of %d chirps loaded", #RUNS))
return update, 1000
